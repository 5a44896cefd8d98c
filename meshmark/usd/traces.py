"""Arrays elsewhere in a layer that equal unmarked points, found by hash and replaced."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Vt

from meshmark.usd.authoring import Witness
from meshmark.usd.layers import extent, vector_array

Float32Array = NDArray[np.float32]


@dataclass
class Traces:
    """Which arrays are unmarked points, and where their marked counterparts are.

    Holds a hash for each frame, not the points.
    """

    _marked: dict[bytes, dict[str, float]] = field(default_factory=dict, init=False)
    _sizes: set[int] = field(default_factory=set, init=False)
    _prims: set[str] = field(default_factory=set, init=False)

    def witness(self, prim: str) -> Witness:
        """Return what remembers each frame of a prim as it is authored."""
        self._prims.add(prim)

        def remember(time: float, original: NDArray[np.floating], _: NDArray[np.floating]) -> None:
            self._sizes.add(len(original))
            self._marked.setdefault(_digest(original), {}).setdefault(prim, time)

        return remember

    def marks(self, attribute: Sdf.AttributeSpec) -> bool:
        """Tell whether an attribute holds the marked points themselves."""
        return attribute.name == "points" and str(attribute.path.GetPrimPath()) in self._prims

    def counterpart(self, value: object, prim: str) -> tuple[str, float] | None:
        """Return the prim and time whose unmarked points a value is, if it is.

        Where several meshes had the same points, the prim the value belongs to goes first.
        """
        # The number of points first: hashing every array of a stage would take long.
        if not isinstance(value, Vt.Vec3fArray) or len(value) not in self._sizes:
            return None
        marked = self._marked.get(_digest(np.asarray(value)))
        if marked is None:
            return None
        return (prim, marked[prim]) if prim in marked else next(iter(marked.items()))


def replace_traces(layer: Sdf.Layer, traces: Traces) -> None:
    """Put marked points wherever a flattened layer holds the same points unmarked.

    A default beside the time samples of a marked prim's points is removed.
    """
    for attribute in _vector_attributes(layer):
        if traces.marks(attribute):
            if layer.GetNumTimeSamplesForPath(attribute.path):
                attribute.ClearDefaultValue()
            continue
        owner = str(attribute.path.GetPrimPath())
        for time in (np.nan, *layer.ListTimeSamplesForPath(attribute.path)):
            found = traces.counterpart(_value(layer, attribute.path, time), owner)
            if found is not None:
                prim, marked_time = found
                points = _value(layer, Sdf.Path(prim).AppendProperty("points"), marked_time)
                _replace(layer, attribute, time, np.asarray(points))


def _replace(
    layer: Sdf.Layer, attribute: Sdf.AttributeSpec, time: float, points: Float32Array
) -> None:
    _set_value(layer, attribute.path, time, points)
    box = attribute.path.GetPrimPath().AppendProperty("extent")
    if attribute.name == "points" and _value(layer, box, time) is not None:
        _set_value(layer, box, time, extent(points))


def _vector_attributes(layer: Sdf.Layer) -> Iterator[Sdf.AttributeSpec]:
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    for path in paths:
        attribute = layer.GetAttributeAtPath(path) if path.IsPropertyPath() else None
        if attribute is not None and attribute.typeName.type == Sdf.ValueTypeNames.Float3Array.type:
            yield attribute


def _value(layer: Sdf.Layer, path: Sdf.Path, time: float) -> object:
    if np.isnan(time):
        attribute = layer.GetAttributeAtPath(path)
        return None if attribute is None else attribute.default
    return layer.QueryTimeSample(path, time)


def _set_value(layer: Sdf.Layer, path: Sdf.Path, time: float, vectors: Float32Array) -> None:
    value = vector_array(np.asarray(vectors, dtype=np.float32))
    if np.isnan(time):
        layer.GetAttributeAtPath(path).default = value
    else:
        layer.SetTimeSample(path, time, value)


def _digest(points: NDArray[np.floating]) -> bytes:
    return hashlib.blake2b(np.ascontiguousarray(points).tobytes(), digest_size=16).digest()
