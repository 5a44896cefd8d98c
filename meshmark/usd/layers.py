"""A new layer: laid over another, written beside its place a batch at a time, moved there."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, Vt

from meshmark.errors import OutputError, UsageError
from meshmark.files.atomic import beside
from meshmark.mesh.asset import Asset
from meshmark.usd.diagnostics import caught, reason
from meshmark.usd.names import LAYER_SUFFIXES
from meshmark.usd.variants import Choice, write_selections

# A crate layer drops from memory what is saved; each save adds about a kilobyte, and the list of
# sample times, to the file.
BATCH_BYTES = 4 << 20

VECTOR_ARRAYS = {
    np.float16: Vt.Vec3hArray,
    np.float32: Vt.Vec3fArray,
    np.float64: Vt.Vec3dArray,
}
# What a `points` attribute is declared as, by the type of its numbers.
POINT_TYPES = {
    np.float16: Sdf.ValueTypeNames.Point3hArray,
    np.float32: Sdf.ValueTypeNames.Point3fArray,
    np.float64: Sdf.ValueTypeNames.Point3dArray,
}

# USD asks these of the root layer alone, never of its sublayers.
STAGE_METADATA = (
    "colorConfiguration",
    "colorManagementSystem",
    "defaultPrim",
    "endTimeCode",
    "expressionVariables",
    "framesPerSecond",
    "kilogramsPerUnit",
    "metersPerUnit",
    "renderSettingsPrimPath",
    "startTimeCode",
    "timeCodesPerSecond",
    "upAxis",
)


@dataclass
class StreamedLayer:
    """A new layer whose time samples go to disk before they fill the memory.

    Only the crate format (.usdc, .usd) can do that; text is held until the end.
    """

    layer: Sdf.Layer
    _unsaved: int = field(default=0, init=False)

    def set(self, attribute: Sdf.AttributeSpec, time: float, value: object, n_bytes: int) -> None:
        """Give an attribute a time sample, or its default if the time is NaN."""
        set_value(self.layer, attribute.path, time, value)
        self._unsaved += n_bytes
        if self._unsaved > BATCH_BYTES and self.layer.GetFileFormat().formatId != "usda":
            self.layer.Save()
            self._unsaved = 0

    def set_vectors(
        self, attribute: Sdf.AttributeSpec, time: float, vectors: NDArray[np.floating]
    ) -> None:
        """Give an attribute (N, 3) vectors at a time, or as its default if the time is NaN."""
        self.set(attribute, time, vector_array(vectors), vectors.nbytes)

    def set_integers(
        self, attribute: Sdf.AttributeSpec, time: float, integers: NDArray[np.int64]
    ) -> None:
        """Give an attribute integers at a time, or as its default if the time is NaN."""
        value = Vt.IntArray.FromNumpy(np.ascontiguousarray(integers, dtype=np.int32))
        self.set(attribute, time, value, 4 * integers.size)


def value_at(layer: Sdf.Layer, path: Sdf.Path, time: float) -> Any:
    """Return a time sample of an attribute, or its default if the time is NaN or infinite."""
    if not np.isfinite(time):
        attribute = layer.GetAttributeAtPath(path)
        return None if attribute is None else attribute.default
    return layer.QueryTimeSample(path, time)


def set_value(layer: Sdf.Layer, path: Sdf.Path, time: float, value: Any) -> None:
    """Give an attribute a time sample, or its default if the time is NaN or infinite."""
    if not np.isfinite(time):
        layer.GetAttributeAtPath(path).default = value
    else:
        layer.SetTimeSample(path, time, value)


def set_field(spec: Sdf.Spec, key: str, value: Any) -> None:
    """Give a prim, property or layer metadata; if it is not of the field's type, take that out.

    A binary layer can hold such values, and so can text, where each may be a path. USD itself
    makes nothing of them.
    """
    try:
        spec.SetInfo(key, value)
    except TypeError:
        spec.ClearInfo(key)


def vector_array(vectors: NDArray[np.floating]) -> Any:
    """Copy (N, 3) half, single or double precision into USD's own array of that type."""
    return VECTOR_ARRAYS[vectors.dtype.type].FromNumpy(np.ascontiguousarray(vectors))


def extent(points: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return the corners of the bounding box of (N, 3) points, (2, 3)."""
    most = np.finfo(np.float32).max
    corners = np.stack([points.min(axis=0), points.max(axis=0)]).astype(np.float64)
    return corners.clip(-most, most).astype(np.float32)


@contextmanager
def new_layer(output: Path) -> Iterator[StreamedLayer]:
    """Make a layer that appears at `output` when the block ends well, and nowhere otherwise.

    Raises
    ------
    UsageError
        If the name does not end in .usd, .usda or .usdc.
    OutputError
        If the place cannot be written to.
    """
    with replacing(output) as place, usd_output_errors(output):
        layer = Sdf.Layer.CreateNew(str(place))
        yield StreamedLayer(layer)
        layer.Save()


@contextmanager
def replacing(output: Path, companion: Path | None = None) -> Iterator[Path]:
    """Give a path beside `output` to write to, moved to `output` when the block ends well.

    Parameters
    ----------
    output : Path
        A .usd, .usda or .usdc file.
    companion : Path, optional
        A folder beside `output`: what the block makes of that name beside the path it is given
        takes its place, together with the file.

    Raises
    ------
    UsageError
        If the name does not end in .usd, .usda or .usdc.
    OutputError
        If the place cannot be written to.
    """
    if output.suffix.lower() not in LAYER_SUFFIXES:
        raise UsageError(f"must end in one of {', '.join(LAYER_SUFFIXES)}", source=output)
    with beside(output) as place:
        yield place
        with ExitStack() as undo:
            if companion is not None and (made := place.with_name(companion.name)).is_dir():
                before = place.with_name("before")
                if companion.exists():
                    companion.rename(before)
                    undo.callback(before.rename, companion)
                made.rename(companion)
                undo.callback(companion.rename, made)
            place.replace(output)
            undo.pop_all()


@contextmanager
def usd_output_errors(output: Path) -> Iterator[None]:
    """Silence pxr while it writes, and turn what it raises into an `OutputError`."""
    with caught(str(output)):
        try:
            yield
        except Tf.ErrorException as error:
            raise OutputError(f"cannot be written: {reason(error)}", source=output) from None


def sublayer_path(source: Path, output: Path) -> str:
    """Return how a layer at `output` names the source: relative, if there is a way.

    The names are compared as they are given: like USD's own resolver, this follows no links.
    """
    try:
        relative = os.path.relpath(source.absolute(), output.absolute().parent)
    except ValueError:
        # Different drives on Windows.
        return source.absolute().as_posix()
    name = Path(relative).as_posix()
    # Without the dot USD would also look for it on its search path.
    return name if name.startswith("../") else f"./{name}"


def lay_over(layer: Sdf.Layer, stage: Usd.Stage, original: Asset, output: Path) -> None:
    """Make a layer that will lie at `output` show the stage of an asset as it was read."""
    copy_stage_metadata(stage.GetRootLayer(), layer)
    layer.subLayerPaths.append(sublayer_path(original.path, output))
    write_selections(layer, map(Choice.parse, original.variants))


def copy_stage_metadata(source: Sdf.Layer, target: Sdf.Layer) -> None:
    """Copy what the source authors of the metadata that counts in a root layer only."""
    for name in STAGE_METADATA:
        if source.pseudoRoot.HasInfo(name):
            set_field(target.pseudoRoot, name, source.pseudoRoot.GetInfo(name))
