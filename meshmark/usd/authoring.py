"""Marked points, authored over a mesh prim in its own space."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from meshmark.arrays import FloatArray
from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.charts import SlidPoints, equal_rows
from meshmark.mesh.precision import stored
from meshmark.mesh.topology import triangulate
from meshmark.usd.baking import bake_normals, unbind
from meshmark.usd.frames import blamed
from meshmark.usd.geometry import (
    REST,
    connectivity_changes,
    local_to_world,
    polygons,
    transformed,
    turned,
)
from meshmark.usd.influences import Influences
from meshmark.usd.layers import POINT_TYPES, StreamedLayer, extent
from meshmark.usd.points import MeshPoints
from meshmark.usd.primvars import LOOKED_AT, spread
from meshmark.usd.rest_pose import RestMoves
from meshmark.usd.skinning import Rig

LocalPoints = NDArray[np.floating]

# Told of each frame as it is authored: time, points before and after, as they are stored.
Witness = Callable[[float, LocalPoints, LocalPoints], None]

# Moves below this fraction of the mesh's size are the rounding of float64, not moves.
NO_MOVE = 1e-14


@dataclass(frozen=True, eq=False)
class MarkedFrames:
    """The points of a prim before and after marking, read a frame at a time.

    Parameters
    ----------
    times : tuple of float
        All at which the source has points.
    marked : tuple of int
        Indices of those that were marked.
    read : callable
        Returns the points (N, 3) before and after of the frame of an index, in the prim's space.
    rig : Rig or None
        What poses the marked points, if they are a rest pose.
    """

    times: tuple[float, ...]
    marked: tuple[int, ...]
    read: Callable[[int], tuple[LocalPoints, LocalPoints]]
    rig: Rig | None = None

    @classmethod
    def of(cls, points: MeshPoints, marked: MeshAnimation) -> MarkedFrames:
        """Pair the times of a prim with those of its marked animation.

        Raises
        ------
        UsageError
            If a marked frame is at a time the source has no points at.
        """
        with blamed(marked.origin, str(points.prim.GetPath())):
            pairs = _matched(points, marked)
        chosen = tuple(i for i, (_, index) in enumerate(pairs) if index is not None)
        return cls(tuple(time for time, _ in pairs), chosen, partial(_read, points, marked, pairs))

    @classmethod
    def rest(cls, before: LocalPoints, after: LocalPoints, rig: Rig | None) -> MarkedFrames:
        """Return a rest pose, one frame that has no time."""
        return cls((np.nan,), (0,), lambda _: (before, after), rig)

    def __iter__(self) -> Iterator[tuple[float, LocalPoints, LocalPoints]]:
        for index, time in enumerate(self.times):
            yield time, *self.read(index)


def author_marked_points(
    target: StreamedLayer,
    over: Sdf.PrimSpec,
    points: MeshPoints,
    marked: MeshAnimation,
    witness: Witness | None = None,
    *,
    normals: bool = True,
) -> MarkedFrames:
    """Give a prim `points` and `extent` at every time its source has points, in its own type.

    A layer with any time sample hides all those of the layers below it, so the frames that were
    not marked are authored too, as they are. Frames are asked for one at a time.

    A rigged prim is baked: it is taken from its skeleton, and gets the normals its rig gives it,
    and as a default the rest pose that its rig would pose like the marked points.

    Parameters
    ----------
    normals : bool
        Whether to write those of a rigged prim.

    Returns
    -------
    MarkedFrames
        What was written.

    Raises
    ------
    UsageError
        If a marked frame is at a time the source has no points at, or has another number of
        points.
    OutputError
        If a marked point is not finite, or beyond what the prim's type holds.
    """
    path, rig = str(points.prim.GetPath()), points.rig
    with blamed(marked.origin, path):
        kind = POINT_TYPES[points.local(points.times()[0]).dtype.type]
        # The default of a rig that stands still is its only pose.
        posed = rig is not None and rig.times.size > 0
        rest = RestMoves(points) if posed and points.has_rest_pose else None
    points_spec = Sdf.AttributeSpec(over, "points", kind)
    extent_spec = Sdf.AttributeSpec(over, "extent", Sdf.ValueTypeNames.Float3Array)
    if rig is not None:
        unbind(over, points.prim)
    frames = MarkedFrames.of(points, marked)
    for time, original, new in frames:
        target.set_vectors(points_spec, time, new)
        target.set_vectors(extent_spec, time, extent(new))
        if rig is not None and normals:
            bake_normals(target, over, rig, time)
        if rest is not None:
            rest.add(time, new - original)
        if witness is not None:
            witness(time, original, new)
    if rest is not None:
        target.set_vectors(points_spec, np.nan, rest.marked())
        if witness is not None:
            witness(REST, rest.points, rest.marked())
    return frames


def author_marked_rest(
    target: StreamedLayer,
    over: Sdf.PrimSpec,
    points: MeshPoints,
    marked: MeshAnimation,
    witness: Witness | None = None,
    *,
    follow: bool = False,
    kept: frozenset[Sdf.Path] = frozenset(),
) -> MarkedFrames:
    """Give a rigged prim the rest pose that its rig poses like the marked points; the rig stays.

    The pose is as near as one can be that fits all marked frames; see `RestMoves`.

    Parameters
    ----------
    follow : bool
        Whether points that slid get the influences of joints, and the offsets of blend shapes, of
        their new places.
    kept : frozenset of Sdf.Path
        Blend shapes that stay as they are.

    Returns
    -------
    MarkedFrames
        The rest pose.

    Raises
    ------
    UsageError
        If the rest pose is animated; or as `author_marked_points`.
    OutputError
        If a point is not finite, or beyond what the prim's type holds.
    """
    path = str(points.prim.GetPath())
    if not points.has_rest_pose:
        raise UsageError(
            "its rest pose is animated, and one mark fits one pose only: bake it instead",
            source=marked.origin,
            prim=path,
        )
    frames = MarkedFrames.of(points, marked)
    rig = _followed(target, over, points, frames, kept) if follow else points.rig
    same, points = rig is points.rig, replace(points, rig=rig)
    rest = RestMoves(points)
    for time, original, new in frames:
        # Another rig poses the unmarked rest pose otherwise, too.
        rest.add(time, new - (original if same else points.local(time)))
        if witness is not None and np.isfinite(time):
            witness(time, original, new)
    spec = Sdf.AttributeSpec(over, "points", POINT_TYPES[rest.points.dtype.type])
    target.set_vectors(spec, np.nan, rest.marked())
    # A default would hide the extents of poses, where there are any.
    if not UsdGeom.Mesh(points.prim).GetExtentAttr().GetNumTimeSamples():
        spec = Sdf.AttributeSpec(over, "extent", Sdf.ValueTypeNames.Float3Array)
        target.set_vectors(spec, np.nan, extent(rest.marked()))
    if witness is not None:
        witness(REST, rest.points, rest.marked())
    return MarkedFrames.rest(rest.points, rest.marked(), points.rig)


def _followed(
    target: StreamedLayer,
    over: Sdf.PrimSpec,
    points: MeshPoints,
    frames: MarkedFrames,
    kept: frozenset[Sdf.Path],
) -> Rig:
    """Write what hangs a rest pose on its rig where its points slid to; return the rig with that.

    The slide is that of the rest pose that was marked with what it hangs on now. It needs no more
    frames than tell what it is like. What is of points that have another number stays.
    """
    rig, rest = points.rig, RestMoves(points)
    assert rig is not None
    n_points = len(rest.points)
    own = Influences.of(rig.skinning, n_points)
    shapes = rig.shapes if rig.shapes is not None and rig.shapes.fits(n_points) else None
    nothing = own is None and shapes is None
    if nothing or connectivity_changes(points.prim, points.times()):
        return rig
    for index in spread(frames.marked, LOOKED_AT):
        before, after = frames.read(index)
        rest.add(frames.times[index], after - before)
    F = triangulate(*polygons(UsdGeom.Mesh(points.prim), Usd.TimeCode.EarliestTime()))
    before, after = (P.astype(np.float64) for P in (rest.points, rest.marked()))
    alike = equal_rows(before if own is None else np.column_stack([before, own.columns]))
    slid = SlidPoints.of(F, before, after, alike if shapes is None else shapes.alike(alike))
    if own is not None:
        influences = own.followed(slid)
        if not influences.equal(own):
            influences.author(target, over)
            rig = replace(rig, influences=influences)
    if shapes is not None:
        followed = shapes.followed(slid, over.path, kept)
        followed.author(target, over, shapes)
        rig = replace(rig, other_shapes=followed)
    return rig


def unmarked_times(points: MeshPoints, marked: MeshAnimation) -> FloatArray:
    """List the times at which the source has points and the marked animation has none."""
    times = points.times()
    return times[~np.isin(_keys(times), _keys(marked.times))]


def _matched(points: MeshPoints, marked: MeshAnimation) -> list[tuple[float, int | None]]:
    """Pair every time of the source with the marked frame at that time, if there is one."""
    times = points.times()
    index_of = {key: index for index, key in enumerate(_keys(marked.times).tolist())}
    strange = marked.times[~np.isin(_keys(marked.times), _keys(times))]
    if strange.size:
        raise UsageError(f"the source has no points at time {strange[0]:g}")
    return [
        (time, index_of.get(key))
        for time, key in zip(times.tolist(), _keys(times).tolist(), strict=True)
    ]


def _read(
    points: MeshPoints, marked: MeshAnimation, pairs: list[tuple[float, int | None]], index: int
) -> tuple[LocalPoints, LocalPoints]:
    time, of_marked = pairs[index]
    with blamed(marked.origin, str(points.prim.GetPath()), time):
        original = points.local(time)
        if of_marked is None:
            return original, original
        return original, _moved(points.prim, time, original, marked[of_marked].points)


def _keys(times: FloatArray) -> FloatArray:
    # "No time" must equal itself, and come before every time.
    return np.where(np.isnan(times), -np.inf, times)


def _moved(prim: Usd.Prim, time: float, original: LocalPoints, marked: FloatArray) -> LocalPoints:
    """Take the moves from world space into the prim's own; what has not moved keeps its bits."""
    _require_fit(marked, len(original))
    matrix = local_to_world(prim, time)
    world = transformed(original, matrix)
    move = marked - world
    still = np.abs(move).max(axis=1) <= NO_MOVE * np.abs(world).max()
    # A prim scaled to nothing in some direction cannot move that way: the pseudo-inverse.
    inverse = np.linalg.pinv(matrix[:3, :3])
    moved = stored(original + turned(move, inverse.astype(np.float64)), original.dtype)
    return np.where(still[:, None], original, moved)


def _require_fit(marked: FloatArray, n_points: int) -> None:
    if marked.shape != (n_points, 3):
        raise UsageError(f"{len(marked)} marked points for {n_points} in the source")
    if not np.isfinite(marked).all():
        raise OutputError("a marked point is not finite")
