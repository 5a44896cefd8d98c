"""What the page shows in three dimensions: a few points in a few frames, and values on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.checks import require_measurable
from meshmark.mesh.frame_range import spread
from meshmark.reporting.camera import Camera, camera_for
from meshmark.reporting.decimation import ShownMesh
from meshmark.reporting.selection import Selection

# Bytes of arrays that a view may have; as text they take a third more.
ROOM = 660_000
# Bytes of a point: in a frame, its value there, its move there, and its triangles and part.
POSITION, VALUE, MOVE, ONCE = 6, 1, 3, 13
# Share of the values that the colours reach up to; the rest has the last colour.
REACHED = 0.995

# Returns values (n,) on points (n, 3) of a mesh at a time, as shares of the diagonal.
Values = Callable[[FloatArray, float], FloatArray]


@dataclass(frozen=True, eq=False)
class Heat:
    """A value on every point, shown by colours.

    Parameters
    ----------
    label : str
        What it is.
    values : (T, n) float64
        Shares of the diagonal.
    top : float
        Value of the last colour.
    """

    label: str
    values: FloatArray
    top: float


@dataclass(frozen=True, eq=False)
class View:
    """What is shown, in lengths of the diagonal, Y up.

    Parameters
    ----------
    selection : Selection
        What was chosen of the asset.
    times : (T,) float64
        Time codes of the frames that could be read.
    positions : (T, n, 3) float64
        The mean of every frame is in the same place.
    faces : (f, 3) int
    parts : (n,) int
        Which part each point belongs to, from 0.
    legend : tuple of str
        Names of the parts.
    anchors : (a,) int
        Points at which carriers stand.
    camera : Camera
    heat : Heat or None
    moves : (T, n, 3) float64 or None
        Displacements by the mark.
    """

    selection: Selection
    times: FloatArray
    positions: FloatArray
    faces: IntArray
    parts: IntArray
    legend: tuple[str, ...]
    anchors: IntArray
    camera: Camera
    heat: Heat | None = None
    moves: FloatArray | None = None


def view_of(
    asset: Asset,
    selection: Selection,
    *,
    label: str = "",
    values: Values | None = None,
    marked: Asset | None = None,
) -> View | None:
    """Read the chosen points at the chosen times; None if nothing can be shown.

    Parameters
    ----------
    asset : Asset
    selection : Selection
        What of it is shown.
    label : str
        What the colours show.
    values : callable, optional
        Gives that.
    marked : Asset, optional
        The same meshes once they were marked: displacements are shown.
    """
    shown = selection.meshes
    twins = None if marked is None else [marked.mesh(each.mesh.prim) for each in shown]
    of_point = POSITION + (values is not None or twins is not None) + MOVE * (twins is not None)
    room = max(1, (ROOM // selection.shown - ONCE) // of_point)
    times = selection.times[spread(len(selection.times), room)].tolist()
    frames = list(_frames(shown, twins, values, times))
    if not frames:
        return None
    P = np.array([frame.points for frame in frames])
    diagonal = float(np.linalg.norm(np.ptp(P[0], axis=0)))
    if not diagonal > 0.0:
        return None
    X = _upright(P - P.mean(axis=1, keepdims=True), asset.up_axis) / diagonal
    X = X - (X.min(axis=(0, 1)) + X.max(axis=(0, 1))) / 2
    moves, shares = None, np.array([frame.values for frame in frames])
    if twins is not None:
        after = np.array([frame.after for frame in frames])
        moves = _upright(after - P, asset.up_axis) / diagonal
        shares = np.linalg.norm(moves, axis=2)
    start = np.cumsum([0, *(len(each.points) for each in shown)])
    parts, legend = _parts(shown)
    return View(
        selection=selection,
        times=np.array([frame.time for frame in frames]),
        positions=X,
        faces=np.concatenate([each.faces + n for each, n in zip(shown, start, strict=False)]),
        parts=parts,
        legend=legend,
        anchors=np.concatenate([each.anchors + n for each, n in zip(shown, start, strict=False)]),
        camera=camera_for(X),
        heat=_heat(label, shares) if shares.size else None,
        moves=moves,
    )


@dataclass(frozen=True, eq=False)
class _Frame:
    """Chosen points of all meshes at a time: before, after, and values; empty where not asked."""

    time: float
    points: FloatArray
    after: FloatArray
    values: FloatArray


def _frames(
    shown: Sequence[ShownMesh],
    twins: Sequence[MeshAnimation] | None,
    values: Values | None,
    times: Sequence[float],
) -> Iterator[_Frame]:
    """Read the frames that can be read."""
    own = [each.mesh for each in shown]
    for time in times:
        try:
            P = _points(own, shown, time)
            after = np.empty(0) if twins is None else _points(twins, shown, time)
        except InputError:
            # Verdicts tell of frames that cannot be read.
            continue
        yield _Frame(time, P, after, np.empty(0) if values is None else values(P, time))


def _points(meshes: Sequence[MeshAnimation], shown: Sequence[ShownMesh], time: float) -> FloatArray:
    """Read the chosen points of meshes, (n, 3), each at the frame that is nearest in time."""
    found = []
    for mesh, chosen in zip(meshes, shown, strict=True):
        gaps = np.abs(np.nan_to_num(mesh.times) - np.nan_to_num(time))
        found.append(mesh[int(gaps.argmin())].points[chosen.points])
        require_measurable(found[-1])
    return np.concatenate(found)


def _upright(P: FloatArray, up_axis: str) -> FloatArray:
    """Turn (..., 3) so that Y is up."""
    if up_axis != "Z":
        return P
    x, y, z = np.moveaxis(P, -1, 0)
    return np.stack([x, z, -y], axis=-1)


def _heat(label: str, shares: FloatArray) -> Heat:
    top = float(np.quantile(shares, REACHED))
    return Heat(label, shares, top or float(shares.max()) or 1e-9)


def _parts(shown: Sequence[ShownMesh]) -> tuple[IntArray, tuple[str, ...]]:
    """Tell apart the parts of all meshes, and name them."""
    parts: list[IntArray] = []
    legend: list[str] = []
    for each in shown:
        labels, own = np.unique(each.parts, return_inverse=True)
        parts.append(len(legend) + own)
        numbered = [f"{each.mesh.prim}, part {k + 1}" for k in range(len(labels))]
        legend += numbered if len(numbered) > 1 else [each.mesh.prim]
    return np.concatenate(parts), tuple(legend)
