"""The scheme itself: a layout of patches on the original, a plan for marking, and evidence."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import BoolArray, FloatArray, IntArray, SignArray
from meshmark.errors import CapacityError
from meshmark.extension.carrier import Observation
from meshmark.extension.informed import AlignedFrame
from meshmark.extension.parameters import require_number
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import surface_box
from meshmark_plugins.schemes.relief.basis import Basis
from meshmark_plugins.schemes.relief.blocks import Block, blocks
from meshmark_plugins.schemes.relief.chips import Heights, soft_chips, soft_chips_in
from meshmark_plugins.schemes.relief.coincidence import log_fits
from meshmark_plugins.schemes.relief.height import slope
from meshmark_plugins.schemes.relief.noise import SmoothNoise
from meshmark_plugins.schemes.relief.offsets import Offsets, mean_height, offsets, sampled
from meshmark_plugins.schemes.relief.plan import ReliefPlan, plan_heights
from meshmark_plugins.schemes.relief.residual import heights
from meshmark_plugins.schemes.relief.treatment import (
    KINDS,
    NONE,
    Treatment,
    between,
    subdivisions,
)

WHAT = "scheme relief"
# One chip in so many is the owner's in every copy; the others are a recipient's, if there is one.
OWNER_EVERY = 8
# Fewer chips could not reach one in a million, whatever they say.
FEWEST_CHIPS = 26
# Priors of these: the recipient's chips, the owner's, all. Where all are one's own, they say much.
PRIORS = (0.6, 0.3, 0.1)
# Vertices that tell what a copy has been through.
SAMPLE = 1500
# Heights of single vertices are kept in so many steps a height of the relief, up to the largest;
# what is unknown is kept as the number below that.
STEPS, MOST_STEPS = 1000, 2**15 - 1


@dataclass(frozen=True, eq=False)
class ReliefLayout:
    """Where chips lie on an original, and how high their relief is.

    Parameters
    ----------
    basis : Basis
        From chips to heights.
    height : float
        A, root mean square of the relief in the unit of the points.
    """

    basis: Basis
    height: float

    @property
    def n_chips(self) -> int:
        """Chips of all levels, K."""
        return self.basis.n_chips

    @property
    def owner(self) -> BoolArray:
        """Which chips are the owner's in every copy, (K,) bool."""
        return np.arange(self.n_chips) % OWNER_EVERY == 0

    @cached_property
    def noise(self) -> SmoothNoise:
        """Noise as smooth as the largest patches."""
        return SmoothNoise(self.basis.levels[0].smoother)

    @cached_property
    def vertices(self) -> IntArray:
        """Vertices that are looked at one by one, (V,)."""
        return sampled(len(self.basis.levels[-1].label))

    @cached_property
    def blocks(self) -> list[Block]:
        """What each block of chips does to them."""
        return list(blocks(self.basis, self.vertices))

    def flattened(self, frames: Sequence[Heights]) -> list[Heights]:
        """Take off what is wider than any patch."""
        value, count = (
            np.stack([getattr(frame, name) for frame in frames], axis=1)
            for name in ("value", "count")
        )
        flat = np.where(count > 0.0, value - self.basis.low_pass(value, count), 0.0)
        return [replace(frame, value=x) for frame, x in zip(frames, flat.T, strict=True)]


@dataclass(frozen=True, eq=False)
class Measured:
    """What one frame shows under one map.

    Parameters
    ----------
    heights : tuple of tuple of Heights
        Above the reference, in each way that may suit what was done to the copy: for each treatment
        by closest points, and by identity where vertices are known.
    offsets : Offsets
        Of single vertices.
    untouched : bool
        Whether the copy is known to be as it was written.
    """

    heights: tuple[tuple[Heights, ...], ...]
    offsets: Offsets
    untouched: bool


class Relief:
    """Bits in low heights above every part of a surface.

    Parameters
    ----------
    max_mrms : float
        Root mean square of the heights, as a share of the bounding box's diagonal; in (0, 0.01).
    slope : float
        Most degrees, root mean square over the surface, by which normals may turn; in (0, 10).
        The height is lowered to that.
    """

    def __init__(self, *, max_mrms: float = 1e-4, slope: float = 0.4) -> None:
        require_number(WHAT, "max_mrms", max_mrms, 0.0, 0.01)
        require_number(WHAT, "slope", slope, 0.0, 10.0)
        self.max_mrms, self.slope = max_mrms, slope

    def layout(self, original: Frame) -> ReliefLayout:
        """Lay patches on a frame of the original, as analysis sees it.

        Raises
        ------
        CapacityError
            If it has too few vertices.
        """
        V, F = original.points, original.faces
        basis = _basis(_Surface.of(original))
        if basis.n_chips < FEWEST_CHIPS:
            raise CapacityError(
                f"{len(V)} points have room for {basis.n_chips} chips; it takes {FEWEST_CHIPS}"
            )
        probe = basis.heights(np.random.default_rng(0).choice((-1.0, 1.0), basis.n_chips))
        steepest = np.radians(self.slope) / slope(V, F, probe)
        return ReliefLayout(basis, min(self.max_mrms * surface_box(V, F)[0], steepest))

    def plan(
        self, animation: MeshAnimation, layout: ReliefLayout, signs: SignArray, *, jobs: int = 1
    ) -> ReliefPlan:
        """Raise and lower every vertex of an animation, as analysis sees it, by a fixed height."""
        f = layout.height * layout.basis.heights(signs.astype(np.float64))
        return ReliefPlan(plan_heights(animation, f), layout.n_chips)

    def treatment(self, views: Sequence[AlignedFrame]) -> Treatment:
        """Choose the smoothing or subdivision that explains a copy best, by what is left."""
        sample = min(map(_sample, views), key=lambda view: heights(view).deviation)

        def left(treatment: Treatment) -> float:
            return heights(sample, treatment).deviation

        finer = subdivisions(len(views[0].reference.points), len(views[0].points))
        known = {each: left(each) for each in (NONE, *finer, *chain.from_iterable(KINDS))}
        best = min(known, key=lambda each: known[each])
        pairs = (pair for kind in KINDS for pair in pairwise(kind) if best in pair)
        near = [each for pair in pairs for each in between(*pair)]
        known |= {each: left(each) for each in near}
        return min(known, key=lambda each: known[each])

    def measure(self, view: AlignedFrame, treatment: Treatment | None) -> Measured:
        """Measure the heights of a copy's frame, in each way that may suit what was done to it."""
        ways = [False] if view.vertices is None else [False, True]
        untouched = treatment is None
        if untouched:
            ways = ways[-1:]
        found = tuple(
            tuple(heights(view, each, by_identity=way) for way in ways)
            for each in dict.fromkeys((NONE, treatment or NONE))
        )
        return Measured(found, offsets(view), untouched)

    def observe(self, measured: Sequence[Measured], layout: ReliefLayout) -> list[Observation]:
        """Estimate the chips of all frames, in each way they were measured.

        The recipient's chips are read, the owner's, and all together, as they are in copies for
        nobody; beside noise that differs from vertex to vertex and from frame to frame, and, where
        something may have been done to the copy, beside noise that is smooth and lasts.
        """
        found = []
        for treated in zip(*(frame.heights for frame in measured), strict=True):
            ways = [layout.flattened(way) for way in zip(*treated, strict=True)]
            found += [soft_chips(layout.basis, layout.height, way) for way in ways]
            if not measured[0].untouched:
                found.append(soft_chips_in(layout.noise, layout.basis, layout.height, ways[-1]))
        owner = layout.owner
        parts = [np.where(part, S, 0.0) for S in found for part in (~owner, owner, True)]
        log_prior = np.log(np.tile(PRIORS, len(found)) / len(found))
        return [
            Observation(soft[:, None, :], log_prior, np.zeros((1, 0)))
            for soft in np.stack(parts, axis=1)
        ]

    def vertex_steps(
        self, measured: Sequence[Sequence[Measured]], layout: ReliefLayout
    ) -> NDArray[np.int16] | None:
        """Round the heights of single vertices, under the map that fits along the surface."""
        by_map = [[frame.offsets for frame in frames] for frames in measured]
        best = min(by_map, key=lambda frames: np.median([one.deviation for one in frames]))
        steps = np.rint(STEPS * mean_height(best) / layout.height)
        if np.isnan(steps).all():
            return None
        bounded = np.clip(steps, -MOST_STEPS, MOST_STEPS)
        return np.where(np.isnan(steps), -MOST_STEPS - 1, bounded).astype(np.int16)

    def vertex_fits(
        self,
        steps: NDArray[np.int16],
        layout: ReliefLayout,
        signs: SignArray,
        decoys: SignArray,
    ) -> FloatArray:
        """Tell how well recipients' chips fit single vertices, block by block."""
        y = np.where(steps < -MOST_STEPS, np.nan, steps / STEPS)
        if len(y) != len(layout.vertices) or np.isnan(y).all():
            return np.zeros((1, len(signs), 1 + len(decoys)))
        return log_fits(
            layout.basis, layout.blocks, layout.owner, layout.vertices, y, signs, decoys
        )


@dataclass(frozen=True)
class _Surface:
    """A frame, equal to any other that shows the same.

    Parameters
    ----------
    digest : bytes
        Of what it shows.
    frame : Frame
    """

    digest: bytes
    frame: Frame = field(compare=False)

    @classmethod
    def of(cls, frame: Frame) -> _Surface:
        """Look at a frame."""
        found = hashlib.blake2b(frame.topology.digest(), digest_size=16)
        found.update(frame.points.tobytes())
        return cls(found.digest(), frame)


@lru_cache(maxsize=2)
def _basis(surface: _Surface) -> Basis:
    """Make the basis of a surface; remembered, as whoever marks it reads it soon."""
    return Basis.of(surface.frame.points, surface.frame.faces)


def _sample(view: AlignedFrame) -> AlignedFrame:
    """Keep some of a copy's vertices."""
    step = max(1, len(view.points) // SAMPLE)
    return replace(view, points=view.points[::step], normals=view.normals[::step], vertices=None)
