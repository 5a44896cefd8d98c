"""What a file gives away to whoever looks at it from outside."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from pxr import Ar, Sdf, Usd, UsdGeom, UsdUtils

from meshmark.arrays import FloatArray
from meshmark.errors import InputError, OutputError
from meshmark.usd.diagnostics import caught
from meshmark.usd.findings import Finding
from meshmark.usd.geometry import REST
from meshmark.usd.metadata import strip_metadata
from meshmark.usd.numbers import Numbers, Place, readings, rewrite_numbers
from meshmark.usd.opening import open_stage
from meshmark.usd.points import StagePoints
from meshmark.usd.prims import is_guide, mesh_prims
from meshmark.usd.stamp import Stamp
from meshmark.usd.stamping import is_stamped, remove_stamps
from meshmark.usd.traces import Copy, Traces

NAMES_LAYER = "it depends on this layer, or names it"
# What rounding leaves may be this much more than is expected of it.
ROUNDING = 1.5


def check_stage(
    source: str,
    marked: Collection[str] = (),
    stamps: Collection[Stamp] = (),
    beat: Callable[[], None] = lambda: None,
) -> list[Finding]:
    """Look for all that a deliverable must not give away.

    Parameters
    ----------
    source : str
        The file.
    marked : collection of str
        Meshes known to be marked, each by itself: they may resemble each other.
    stamps : collection of Stamp
        Those that meshes were meant to have.
    beat : callable
        Called as the work goes on.

    Returns
    -------
    list of Finding
        Sorted.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    opened = open_stage(source)
    stage = opened.stage
    with caught(source):
        layer = stage.GetRootLayer()
        # A package is checked by what it opens with.
        scratch = Sdf.Layer.CreateAnonymous(".usda")
        scratch.TransferContent(layer)
        found = _copies(scratch, _own_traces(opened.points, beat), set(marked), beat)
        found |= _layers(layer) | _paths(scratch)
        found |= {
            Finding("metadata", where.strip(), what.strip() or "tells of the origin")
            for where, _, what in (
                each.partition(": ")
                for each in (*strip_metadata(scratch, stage), *remove_stamps(scratch, stamps))
            )
        }
    return sorted(found)


def has_meshes(source: str) -> bool:
    """Tell whether a stage shows a mesh that somebody might want to mark."""
    stage = open_stage(source).stage
    with caught(source):
        return any(not is_guide(prim) for prim in mesh_prims(stage))


def frames_without_mark(source: str, marked: Collection[str]) -> list[Finding]:
    """List the marked meshes that weaker layers have points of at times the strongest has not.

    A source grew, and the layer over it hides the frames it does not know.

    Parameters
    ----------
    marked : collection of str
        Meshes known to be marked, besides those that are stamped.
    """
    stage = open_stage(source).stage
    found = []
    with caught(source):
        for prim in mesh_prims(stage):
            if str(prim.GetPath()) in marked or is_stamped(prim):
                hidden = _hidden_times(UsdGeom.Mesh(prim).GetPointsAttr())
                if hidden:
                    what = f"hides {len(hidden)} frames of its source, {min(hidden):g} first"
                    found.append(Finding("frames", str(prim.GetPath()), what))
    return found


def _hidden_times(points: Usd.Attribute) -> set[float]:
    """Return the times at which weaker layers have points, and the strongest has none."""
    shown = points.GetTimeSamples()
    if not shown:
        return set()
    stack = points.GetPropertyStackWithLayerOffsets()
    below = (
        offset * time
        for spec, offset in stack
        for time in spec.layer.ListTimeSamplesForPath(spec.path)
    )
    # Times that an offset has moved are rounded.
    return {time for time in below if not np.isclose(shown, time, rtol=1e-9, atol=1e-9).any()}


def require_no_traces(file: Path, traces: Traces, output: Path) -> None:
    """Refuse a deliverable that still holds copies of the original's points.

    Parameters
    ----------
    file : Path
        As written, wherever it lies now.
    traces : Traces
        The original's points.
    output : Path
        What it will be, for the error.

    Raises
    ------
    OutputError
        Naming what resembles the original more than the marked mesh.
    """
    layer = Sdf.Layer.OpenAsAnonymous(str(file))
    own = {f"{prim}.points" for prim in traces.shapes}

    def unmarked(copy: Copy, rounding: float) -> bool:
        points = traces.marked(layer, copy.prim, copy.match.time)
        residual = _residual(copy, points)
        return residual > rounding and copy.match.residual < residual

    def look(array: Numbers, place: Place) -> tuple[Numbers, set[str]]:
        return array, set() if place.path in own else _suspects(array, place, traces, (), unmarked)

    left = sorted(rewrite_numbers(layer, look))
    if left:
        names = ", ".join(path for path, _ in left[:5])
        raise OutputError(
            f"would still hold unmarked points, in {names}: leave that out of the source",
            source=output,
            prim=left[0][1],
        )


def _own_traces(points: StagePoints, beat: Callable[[], None]) -> Traces:
    traces = Traces(points)
    for prim in mesh_prims(points.stage):
        path, mesh = str(prim.GetPath()), points.of(prim)
        try:
            for time in [*mesh.times().tolist(), *[REST] * mesh.has_rest_pose]:
                beat()
                traces.add(path, time, mesh.local(time))
        except InputError:
            # A mesh without a shape has no copies.
            traces.shapes.pop(path, None)
    return traces


def _copies(
    layer: Sdf.Layer, traces: Traces, marked: set[str], beat: Callable[[], None]
) -> set[Finding]:
    def differs(copy: Copy, rounding: float) -> bool:
        return copy.match.residual > rounding

    def look(array: Numbers, place: Place) -> tuple[Numbers, set[str]]:
        beat()
        without: set[str] = set()
        if place.path == f"{place.owner}.points" and place.owner in traces.shapes:
            sampled = np.isnan(place.time) and layer.GetNumTimeSamplesForPath(place.path)
            without = (marked if place.owner in marked else set()) | {place.owner}
            without -= {place.owner} if sampled else set()
        return array, _suspects(array, place, traces, without, differs)

    return {
        Finding("copy", path, f"resembles the points of {prim}, and differs a little")
        for path, prim in rewrite_numbers(layer, look)
    }


def _suspects(
    array: Numbers,
    place: Place,
    traces: Traces,
    without: Collection[str],
    suspect: Callable[[Copy, float], bool],
) -> set[str]:
    """Name the meshes of which an array holds a copy that is suspect, given its rounding."""
    for table, _ in readings(array):
        found = traces.find(table.astype(np.float64), place, without)
        if found:
            return {copy.prim for copy in found if suspect(copy, _rounding(copy, table.dtype))}
    return set()


def _rounding(copy: Copy, dtype: np.dtype[Any]) -> float:
    """Estimate the residual that storing numbers of a type leaves, over the diagonal."""
    values = copy.values
    step = np.ones_like(values)
    if dtype.kind == "f":
        # The points of meshes are single precision, and so are copies that are stored in more.
        step = _spacing(values, np.float16 if dtype == np.float16 else np.float32)
    gain = np.linalg.norm(copy.match.matrix[:3], axis=0)
    size = np.abs(values).max(axis=0) / gain
    own = float(_spacing(size.max(), np.float32))
    left = np.sqrt(np.mean(step**2, axis=0)) / gain
    return float(ROUNDING * (left.max() + own) / copy.match.diagonal / np.sqrt(12))


def _spacing(values: FloatArray, dtype: type[np.floating]) -> FloatArray:
    """Return the distances between neighbouring numbers of a type, as if it had no largest one."""
    about = np.finfo(dtype)
    exponent = np.where(values == 0.0, about.minexp, np.frexp(values)[1] - 1)
    return np.ldexp(float(about.eps), np.maximum(exponent, about.minexp))


def _residual(copy: Copy, points: FloatArray) -> float:
    """Fit a copy to other points of the same vertices; the residual over the diagonal."""
    P = np.column_stack([points[copy.match.vertices], np.ones(len(copy.match.vertices))])
    values = copy.values
    matrix = np.linalg.lstsq(P, values, rcond=1e-9)[0]
    gain = np.linalg.norm(matrix[:3], axis=0)
    off = np.sqrt(np.mean((values - P @ matrix) ** 2, axis=0))
    diagonal = np.linalg.norm(np.ptp(points, axis=0))
    return float(np.sqrt(np.mean((off / (gain * diagonal)) ** 2)))


def _layers(layer: Sdf.Layer) -> set[Finding]:
    return {
        Finding("layer", path, NAMES_LAYER)
        for path in layer.GetCompositionAssetDependencies()
        if path
    }


def _paths(layer: Sdf.Layer) -> set[Finding]:
    found: set[Finding] = set()

    def look(path: str) -> str:
        outer = Ar.SplitPackageRelativePathOuter(path)[0] or path
        if Sdf.FileFormat.FindByExtension(path):
            found.add(Finding("layer", path, NAMES_LAYER))
        elif outer.startswith(("/", "~")) or PureWindowsPath(outer).drive:
            found.add(Finding("path", path, "absolute"))
        elif ".." in Path(outer.replace("\\", "/")).parts:
            found.add(Finding("path", path, "leads out of the folder"))
        return path

    UsdUtils.ModifyAssetPaths(layer, look)
    return found
