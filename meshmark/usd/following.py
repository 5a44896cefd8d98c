"""What hangs on points follows them over the old surface, when a mark has slid them."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf

from meshmark.arrays import FloatArray
from meshmark.mesh.charts import Charts, Places, turned_along
from meshmark.mesh.geometry import normalized
from meshmark.usd.authoring import MarkedFrames
from meshmark.usd.layers import StreamedLayer
from meshmark.usd.points import MeshPoints
from meshmark.usd.primvars import LOOKED_AT, Hanging, hanging_on, spread

# One value does for all frames where it leaves a tenth of what would be off without it, or as
# much of the values' range as a tenth of a texel is of a map 4096 wide.
SHARE = 0.1
FINE = 0.1 / 4096
# Unit vectors this near to each other differ by the rounding of float64.
SAME = 1e-12


def author_followed(
    target: StreamedLayer,
    over: Sdf.PrimSpec,
    points: MeshPoints,
    frames: MarkedFrames,
    *,
    posed: bool,
    kept: Container[str] = (),
    is_copy: Callable[[Hanging], bool] = lambda _: False,
) -> None:
    """Give what hangs on a prim's points the values of the places that these have slid to.

    Each vertex lies somewhere on the unmarked surface of its frame. It gets the value there,
    interpolated; across a seam each side by itself, continued beyond it. Normals are also turned
    as the surface was. What changes in no frame is not written. An attribute without time samples
    stays without, if one value for each point does for all frames; otherwise it gets samples at
    the times of the points, and the mean as its default. Beside a rest pose it stays without in any
    case, and gets the mean over the poses.

    Parameters
    ----------
    target : StreamedLayer
        Lies over the stage of the prim.
    over : Sdf.PrimSpec
        Where the prim is in it.
    points : MeshPoints
        The prim.
    frames : MarkedFrames
        Its points before and after.
    posed : bool
        Whether the frames show what a rig makes of the prim, and the rig is taken off.
    kept : container of str
        Names of attributes that are to stay as they are.
    is_copy : callable
        Tells which attributes are copies of points: these stay, too.
    """
    found = hanging_on(points, posed=posed)
    followers = [Follower(each) for each in found if each.name not in kept and not is_copy(each)]
    if not followers:
        return
    rest = points.rig is not None and not posed
    shown = _poses(points, frames) if rest else frames
    # Normals of a rest pose turn as that does; a rig turns them on.
    on_rest = [each for each in followers if rest and each.hanging.is_normal]
    for index in spread(shown.marked, LOOKED_AT):
        slide = Slide(*shown.read(index))
        for follower in followers:
            if follower not in on_rest:
                follower.look(shown.times[index], slide)
    for follower in on_rest:
        follower.look(np.nan, Slide(*frames.read(0)))
    static = len(frames.marked) == len(frames.times)
    changed = [follower for follower in followers if follower.changes]
    for follower in changed:
        follower.author_default(target, over)
    # A rig may show poses that nobody has seen yet: samples would be those of others.
    single = [each for each in changed if static and (each.one_does or (rest and each.still))]
    sampled = [each for each in changed if each not in single]
    # What is sampled before the first frame is shown with that.
    starts = (-np.inf, *frames.times[1:], np.inf)
    for index, time in enumerate(frames.times if sampled else ()):
        slide = Slide(*frames.read(index))
        for follower in sampled:
            follower.author_samples(target, over, slide, time, starts[index : index + 2])


@dataclass(frozen=True, eq=False)
class Slide:
    """The points (N, 3) of a frame before and after marking, and where they lie by chart."""

    before: NDArray[np.floating]
    after: NDArray[np.floating]
    _places: dict[int, Places] = field(default_factory=dict, init=False)
    _normals: dict[int, tuple[FloatArray, FloatArray]] = field(default_factory=dict, init=False)

    def places(self, charts: Charts) -> Places:
        """Find where the rows of charts lie on the surface before."""
        if id(charts) not in self._places:
            V, X = (P.astype(np.float64) for P in (self.before, self.after))
            self._places[id(charts)] = charts.places(V, X)
        return self._places[id(charts)]

    def normals(self, charts: Charts) -> tuple[FloatArray, FloatArray]:
        """Compute unit normals (R, 3): of the surface before where rows lie, and after."""
        if id(charts) not in self._normals:
            before, after = (
                charts.normals(P.astype(np.float64)) for P in (self.before, self.after)
            )
            there = normalized(self.places(charts).values(before))
            self._normals[id(charts)] = (there, after)
        return self._normals[id(charts)]


@dataclass(eq=False)
class Follower:
    """An attribute that follows, and by how much its values changed in the frames looked at.

    Parameters
    ----------
    hanging : Hanging
        The attribute.
    """

    hanging: Hanging
    changes: bool = field(default=False, init=False)
    _looks: int = field(default=0, init=False)
    _sum: FloatArray | float = field(default=0.0, init=False)
    _squares: float = field(default=0.0, init=False)
    _range: float = field(default=0.0, init=False)

    def look(self, time: float, slide: Slide) -> None:
        """Take note of what a slide does to the values at a time."""
        before, after = self._followed(time, slide)
        change = after - before
        self._looks += 1
        self._sum = self._sum + change
        self._squares += float(np.sum(change**2))
        self._range = max(self._range, float(np.ptp(before, axis=0).max(initial=0.0)))
        stored = self.hanging.stored
        self.changes |= self.hanging.rig is not None or stored(before) != stored(after)

    @property
    def still(self) -> bool:
        """Whether the values are the same at all times, before a mark changes them."""
        return self.hanging.rig is None and len(self.hanging.times) < 2

    @property
    def one_does(self) -> bool:
        """Whether the mean of the changes does for all frames; see `author_followed`."""
        if not self.still:
            return False
        mean = self._mean
        left = max(self._squares / self._looks - float(np.sum(mean**2)), 0.0)
        return left <= max(
            SHARE**2 * self._squares / self._looks, mean.size * (FINE * self._range) ** 2
        )

    @property
    def _mean(self) -> FloatArray:
        return np.asarray(self._sum) / self._looks

    def author_default(self, target: StreamedLayer, over: Sdf.PrimSpec) -> None:
        """Write the mean, and which corner has which value."""
        hanging, rows = self.hanging, self.hanging.layout.rows
        spec = Sdf.AttributeSpec(over, hanging.name, hanging.attribute.GetTypeName())
        values = hanging.values(np.nan) + self._mean
        if hanging.is_unit:
            values = normalized(values)
        self._set(target, spec, np.nan, values)
        if not hanging.can_have_indices or (rows is None and not hanging.is_indexed):
            return
        indices = Sdf.AttributeSpec(over, f"{hanging.name}:indices", Sdf.ValueTypeNames.IntArray)
        if rows is None:
            # A value for each point: the indices below would pick wrong ones.
            indices.default = Sdf.ValueBlock()
        else:
            target.set_integers(indices, np.nan, rows)

    def author_samples(
        self,
        target: StreamedLayer,
        over: Sdf.PrimSpec,
        slide: Slide,
        time: float,
        between: Sequence[float],
    ) -> None:
        """Write the values of a frame, and those that are sampled in its stretch of time."""
        hanging, (start, end) = self.hanging, between
        own = () if hanging.rig is not None else hanging.times
        times = {other for other in own if start <= other < end}
        for each in sorted(times | {time} if np.isfinite(time) else times):
            values = self._followed(each, slide)[1]
            self._set(target, over.attributes[hanging.name], each, values)

    def _set(
        self, target: StreamedLayer, spec: Sdf.AttributeSpec, time: float, values: FloatArray
    ) -> None:
        stored = self.hanging.stored(values)
        target.set(spec, time, stored, np.asarray(stored).nbytes)

    def _followed(self, time: float, slide: Slide) -> tuple[FloatArray, FloatArray]:
        """Return the values (R, k) at a time, before and after."""
        hanging, charts = self.hanging, self.hanging.layout.charts
        before = hanging.values(time)
        after = slide.places(charts).values(before, continued=hanging.is_map)
        touched = np.any(after != before, axis=1)
        if hanging.is_normal:
            there, here = slide.normals(charts)
            touched |= np.any(np.abs(there - here) > SAME, axis=1)
            after = turned_along(after, there, here)
        if hanging.is_unit:
            after = normalized(after)
        return before, np.where(touched[:, None], after, before)


def _poses(points: MeshPoints, rest: MarkedFrames) -> MarkedFrames:
    """Return what a rig makes of a rest pose before and after, at all its times."""
    rig, [(_, _, marked)] = rest.rig, rest
    assert rig is not None

    def read(index: int) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        before = points.local(times[index])
        return before, rig.pose(marked, times[index]).astype(before.dtype)

    times = tuple(points.times().tolist())
    return MarkedFrames(times, tuple(range(len(times))), read)
