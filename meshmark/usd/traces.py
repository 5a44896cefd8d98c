"""Copies of unmarked points elsewhere in a layer, in whatever form: found, and moved along."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, Vt

from meshmark.copies import Match, Shape, find_cloud, find_in_order
from meshmark.usd.authoring import Witness
from meshmark.usd.geometry import local_points, local_to_world
from meshmark.usd.layers import extent, vector_array
from meshmark.usd.metadata import paths_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Numbers = NDArray[Any]
# Points (N, 3) of a prim at a time.
Points = Callable[[str, float], FloatArray]

# Integers that say which, not where.
WHICH = re.compile(
    r"faceVertex(Counts|Indices)|curveVertexCounts|.*[iI]ndices|.*:indices|ids|protoIndices"
)
# Bytes and integers may be floating-point numbers in disguise.
DISGUISES = ("<f4", "<f8", "<f2")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MIN_NUMBERS = 96
MAX_STACK = 4096
EXACT = 1e-6


@dataclass(frozen=True, order=True)
class Moved:
    """A copy of a mesh's points that got the marked ones.

    Parameters
    ----------
    path : str
        The attribute, or the prim or property and the key of its metadata.
    prim : str
        The mesh.
    """

    path: str
    prim: str


@dataclass
class Traces:
    """The unmarked points of all marked meshes, and what to look for.

    Holds samples of the poses, not the points: these are read again from the stage.
    """

    stage: Usd.Stage
    shapes: dict[str, Shape] = field(default_factory=dict, init=False)

    def witness(self, prim: str) -> Witness:
        """Return what remembers each frame of a prim as it is authored."""
        mesh = self.stage.GetPrimAtPath(prim)
        corners = mesh.GetAttribute("faceVertexIndices").Get(Usd.TimeCode.EarliestTime())

        def remember(time: float, original: Numbers, _: Numbers) -> None:
            if prim not in self.shapes:
                corner = np.asarray(() if corners is None else corners, dtype=np.int64)

                def read(time: float) -> FloatArray:
                    return local_points(mesh, time).astype(np.float64)

                self.shapes[prim] = Shape(len(original), corner, read)
            self.shapes[prim].add(time, original.astype(np.float64))

        return remember

    def marks(self, attribute: Sdf.AttributeSpec) -> bool:
        """Tell whether an attribute holds the marked points themselves."""
        return attribute.name == "points" and str(attribute.path.GetPrimPath()) in self.shapes

    def moved(
        self,
        array: Numbers,
        marked: Points,
        *,
        owner: str = "",
        time: float = np.nan,
        indices: IntArray | None = None,
        clouds: bool = True,
    ) -> tuple[Numbers, set[str]]:
        """Replace what an array holds of unmarked points.

        Parameters
        ----------
        array : (M, ...) numbers
            Of any type.
        marked : callable
            Returns the marked points of a prim at a time.
        owner : str
            Prim the array belongs to: of meshes that were alike, it is the first choice.
        time : float
            Time the array is given at.
        indices : (I,) int, optional
            Row for each vertex or corner, where the array is indexed.
        clouds : bool
            Whether to look for points in any order, too, which takes longer.

        Returns
        -------
        array : (M, ...) numbers
            Of the same type.
        prims : set of str
            The meshes whose points were found; none if the array is as it was.
        """
        shapes = sorted(self.shapes.items(), key=lambda each: each[0] != owner)
        for numbers, back in _readings(array):
            new = numbers.copy()
            found = _move_in_order(new, shapes, marked, time, indices)
            if not found and clouds:
                found = self._move_clouds(new, shapes, marked, time)
            if found:
                return back(new, new != numbers), found
        return array, set()

    def _move_clouds(
        self,
        numbers: FloatArray,
        shapes: Iterable[tuple[str, Shape]],
        marked: Points,
        time: float,
    ) -> set[str]:
        for cloud in _clouds(numbers):
            found: set[str] = set()
            left = np.arange(len(cloud))
            for prim, shape in shapes:
                to_world = partial(local_to_world, self.stage.GetPrimAtPath(prim))
                match = find_cloud(cloud[left], shape, hint=time, to_world=to_world)
                if match is not None:
                    cloud[left[match.rows]] = match.image(marked(prim, match.time))
                    left = np.delete(left, match.rows)
                    found.add(prim)
            if found:
                return found
        return set()


def _move_in_order(
    numbers: FloatArray,
    shapes: Iterable[tuple[str, Shape]],
    marked: Points,
    time: float,
    indices: IntArray | None,
) -> set[str]:
    matches: list[tuple[float, str, FloatArray, Match]] = []
    for prim, shape in shapes:
        for vertices, sample_rows in shape.layouts():
            for view, rows, of_samples in _views(numbers, vertices, sample_rows, indices):
                found = find_in_order(view, shape, rows, of_samples, time)
                matches.extend((match.residual, prim, view, match) for match in found)
    taken: set[tuple[int, int, int]] = set()
    moved: set[str] = set()
    # Of equally good ones the first, which is the owner's.
    for _, prim, view, match in sorted(matches, key=lambda each: max(each[0], EXACT)):
        place = view.__array_interface__["data"][0]
        keys = {(place, view.shape[1], int(column)) for column in match.columns}
        if taken & keys:
            continue
        taken |= keys
        view[np.ix_(match.rows, match.columns)] = match.image(marked(prim, match.time))
        moved.add(prim)
    return moved


def _views(
    numbers: FloatArray, vertices: IntArray, sample_rows: IntArray, indices: IntArray | None
) -> Iterator[tuple[FloatArray, IntArray, IntArray]]:
    """See numbers (M, d) as rows, one for each entry of `vertices`, in every way they could be.

    Yields
    ------
    view : (R, c) float64
        Writes through to the numbers.
    vertices : (R,) int
        Vertex of each row.
    sample_rows : (S,) int
        Row of each sampled vertex.
    """
    M, d = numbers.shape
    R = len(vertices)
    if indices is not None and len(indices) == R and M and 0 <= indices.min() <= indices.max() < M:
        rows, first = np.unique(indices, return_index=True)
        if np.array_equal(rows, np.arange(M)):
            yield numbers, vertices[first], indices[sample_rows]
            return
    if R == 0 or M % R or M == 0 or M // R > MAX_STACK:
        return
    k = M // R
    for each in numbers.reshape(k, R, d):
        yield each, vertices, sample_rows
    if k > 1 and k * d <= MAX_STACK:
        yield numbers.reshape(R, k * d), vertices, sample_rows


def _clouds(numbers: FloatArray) -> Iterator[FloatArray]:
    """See numbers (M, d) as points (K, 3), in every way they could be; writes go through."""
    M, d = numbers.shape
    if d in (3, 4):
        yield numbers[:, :3]
    elif d == 16:
        yield numbers[:, 12:15]
    elif d == 1 and numbers.size >= MIN_NUMBERS:
        if M % 3 == 0:
            yield numbers.reshape(-1, 3)
            yield numbers.reshape(3, -1).T
        if M % 4 == 0:
            yield numbers.reshape(-1, 4)[:, :3]


Back = Callable[[FloatArray, NDArray[np.bool_]], Numbers]


def _readings(array: Numbers) -> Iterator[tuple[FloatArray, Back]]:
    """Read an array as numbers (M, d), and say how to write changed ones back."""
    if array.size == 0:
        return

    def reading(numbers: Numbers, back: Callable[[Numbers], Numbers]) -> tuple[FloatArray, Back]:
        table = numbers.reshape(len(numbers), -1)

        def write(new: FloatArray, changed: NDArray[np.bool_]) -> Numbers:
            result = table.copy()
            result[changed] = _cast(new[changed], table.dtype)
            return back(result)

        return table.astype(np.float64), write

    yield reading(array, lambda new: new.reshape(array.shape))
    if array.dtype.kind not in "iu":
        return
    raw = np.ascontiguousarray(array).reshape(-1)
    for kind in DISGUISES:
        dtype = np.dtype(kind)
        if raw.nbytes % dtype.itemsize == 0 and dtype.itemsize >= array.dtype.itemsize:
            yield reading(
                raw.view(dtype), lambda new: new.reshape(-1).view(array.dtype).reshape(array.shape)
            )


def _cast(values: FloatArray, dtype: np.dtype[Any]) -> Numbers:
    if dtype.kind in "iu":
        limits = np.iinfo(dtype)
        return np.rint(values).clip(limits.min, limits.max).astype(dtype)
    return values.astype(dtype)


def replace_traces(layer: Sdf.Layer, traces: Traces) -> list[Moved]:
    """Put marked points wherever a flattened layer holds an image of the same points unmarked.

    A default beside the time samples of a marked prim's points is removed.

    Returns
    -------
    list of Moved
        What was replaced, sorted.
    """

    def marked(prim: str, time: float) -> FloatArray:
        points = _value(layer, Sdf.Path(prim).AppendProperty("points"), time)
        return np.asarray(points, dtype=np.float64)

    moved: set[Moved] = set()
    for path in paths_of(layer):
        attribute = layer.GetAttributeAtPath(path) if path.IsPropertyPath() else None
        if attribute is not None:
            if traces.marks(attribute):
                if layer.GetNumTimeSamplesForPath(path):
                    attribute.ClearDefaultValue()
            else:
                moved |= _replace_in_attribute(layer, attribute, traces, marked)
        moved |= _replace_in_metadata(layer, path, traces, marked)
    return sorted(moved)


def _replace_in_attribute(
    layer: Sdf.Layer, attribute: Sdf.AttributeSpec, traces: Traces, marked: Points
) -> set[Moved]:
    path, owner = attribute.path, str(attribute.path.GetPrimPath())
    if WHICH.fullmatch(attribute.name) and attribute.typeName.type.typeName.startswith("VtArray<i"):
        return set()
    samples = layer.ListTimeSamplesForPath(path)
    indices = _numbers(_value(layer, Sdf.Path(f"{path}:indices"), np.nan))

    def found_at(time: float, clouds: bool) -> tuple[Any, set[str]]:
        return _replaced(
            _value(layer, path, time),
            lambda array: traces.moved(
                array, marked, owner=owner, time=time, indices=indices, clouds=clouds
            ),
        )

    # Looking for points in any order takes long: three samples tell whether it is worth it.
    probes = {samples[0], samples[len(samples) // 2], samples[-1]} if samples else set()
    clouds = len(samples) <= len(probes) or any(found_at(time, True)[1] for time in probes)
    moved: set[Moved] = set()
    for time in (np.nan, *samples):
        value, prims = found_at(time, clouds or bool(np.isnan(time)))
        if prims:
            _set_value(layer, path, time, value)
            _fit_extent(layer, attribute, time)
            moved |= {Moved(str(path), prim) for prim in prims}
    return moved


def _replace_in_metadata(
    layer: Sdf.Layer, path: Sdf.Path, traces: Traces, marked: Points
) -> set[Moved]:
    spec = layer.GetObjectAtPath(path)
    if spec is None:
        return set()
    moved: set[Moved] = set()

    def replaced(value: Any, key: str) -> Any:
        if isinstance(value, Mapping):
            return {name: replaced(each, f"{key}:{name}") for name, each in value.items()}
        new, prims = _replaced(
            value, lambda array: traces.moved(array, marked, owner=str(path.GetPrimPath()))
        )
        moved.update(Moved(f"{path} {key}", prim) for prim in prims)
        return new

    for field_name in spec.ListInfoKeys():
        if field_name not in ("default", "timeSamples"):
            before = len(moved)
            value = replaced(spec.GetInfo(field_name), field_name)
            if len(moved) > before:
                spec.SetInfo(field_name, value)
    return moved


def _replaced(
    value: Any, move: Callable[[Numbers], tuple[Numbers, set[str]]]
) -> tuple[Any, set[str]]:
    """Let numbers be moved, whatever holds them: an array, or a text."""
    if isinstance(value, str):
        return _replaced_in_text(value, move)
    if isinstance(value, Vt.StringArray | Vt.TokenArray):
        text, prims = _replaced_in_text("\0".join(value), move)
        return (type(value)(text.split("\0")), prims) if prims else (value, prims)
    numbers = _numbers(value)
    if numbers is None:
        return value, set()
    new, prims = move(numbers)
    return (type(value).FromNumpy(np.ascontiguousarray(new)), prims) if prims else (value, prims)


def _replaced_in_text(
    text: str, move: Callable[[Numbers], tuple[Numbers, set[str]]]
) -> tuple[str, set[str]]:
    if len(text) < 2 * MIN_NUMBERS:
        return text, set()
    numbers = np.array([float(number) for number in NUMBER.findall(text)])
    if len(numbers) < MIN_NUMBERS:
        return text, set()
    new, prims = move(numbers)
    if not prims:
        return text, prims
    put = iter(new.tolist())
    return NUMBER.sub(lambda _: f"{next(put):.9g}", text), prims


def _numbers(value: Any) -> Numbers | None:
    """See a value as numbers, if it is an array of them."""
    if not hasattr(type(value), "FromNumpy"):
        return None
    array = np.asarray(value)
    return array if array.dtype.kind in "fiu" and array.size else None


def _fit_extent(layer: Sdf.Layer, attribute: Sdf.AttributeSpec, time: float) -> None:
    box = attribute.path.GetPrimPath().AppendProperty("extent")
    if attribute.name == "points" and _value(layer, box, time) is not None:
        points = np.asarray(_value(layer, attribute.path, time))
        _set_value(layer, box, time, vector_array(extent(points)))


def _value(layer: Sdf.Layer, path: Sdf.Path, time: float) -> Any:
    if np.isnan(time):
        attribute = layer.GetAttributeAtPath(path)
        return None if attribute is None else attribute.default
    return layer.QueryTimeSample(path, time)


def _set_value(layer: Sdf.Layer, path: Sdf.Path, time: float, value: Any) -> None:
    if np.isnan(time):
        layer.GetAttributeAtPath(path).default = value
    else:
        layer.SetTimeSample(path, time, value)
