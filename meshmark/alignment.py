"""Which carrier of one frame is which of another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from meshmark.carrier import Sighting
from meshmark.errors import CapacityError
from meshmark.placement import Placement

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# (own sighting, reference sighting) -> cost (C, D) of matching own carriers with those of the
# reference; inf where a match is out of the question.
Matcher = Callable[[Sighting, Sighting], FloatArray]

# Farthest that a tip may wander over the surface between two poses, as a share of the diagonal.
WANDER = 0.05
# Worth of agreeing evidence beside agreeing shapes.
AGREEMENT = 0.1
# Stands for "out of the question" in sums that must stay finite.
_NEVER = 1e6


def in_order(own: Sighting, reference: Sighting) -> FloatArray:
    """Match carriers by their order, which a common layout fixes."""
    return np.where(np.eye(len(own.descriptors), len(reference.descriptors)) > 0, 0.0, np.inf)


def by_place(points: FloatArray) -> Matcher:
    """Match carriers whose vertices lie near each other on one frame, `points` (N, 3)."""
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0

    def cost(own: Sighting, reference: Sighting) -> FloatArray:
        assert own.vertices is not None
        assert reference.vertices is not None
        gap = cdist(points[own.vertices], points[reference.vertices]) / (WANDER * diagonal)
        return np.where(gap <= 1.0, gap, np.inf)

    return cost


def by_looks(own: Sighting, reference: Sighting) -> FloatArray:
    """Match carriers alike in shape and in what they say.

    Left and right of a symmetric body have the same shape, but not the same evidence: what a
    carrier says in one frame, the same carrier says in the next, mark and mesh alike.
    """
    shape = cdist(own.descriptors, reference.descriptors)
    said, told = (sighting.soft[0].astype(np.float64) for sighting in (own, reference))
    return shape + AGREEMENT * (1.0 - _agreement(said, told))


def _agreement(S: FloatArray, reference: FloatArray) -> FloatArray:
    """Correlation of the evidence (C, K) of each carrier with that (D, K) of each other."""
    S = S / np.maximum(np.linalg.norm(S, axis=1, keepdims=True), 1e-12)
    reference = reference / np.maximum(np.linalg.norm(reference, axis=1, keepdims=True), 1e-12)
    return S @ reference.T


@dataclass(frozen=True, eq=False)
class Aligned:
    """Sightings of several frames, their carriers in one order.

    Parameters
    ----------
    soft : (T, R, C, K) floating
        Evidence, in the type it was given; a carrier missing from a frame is all erasures there.
    log_prior : (R,) float64
        Log belief in each reading.
    placements : tuple of Placement, or None
        Which words carriers may hold, as each frame tells.
    """

    soft: NDArray[Any]
    log_prior: FloatArray
    placements: tuple[Placement, ...] | None


def aligned(sightings: Sequence[Sighting | None], matcher: Matcher) -> Aligned:
    """Put the carriers of every frame into the order of the frame that shows the most.

    Carriers are matched one to one, at the least total cost. That needs no key, so a wrong
    match costs evidence but never honesty.

    Raises
    ------
    CapacityError
        If no frame shows any carrier.
    """
    seen = [sighting for sighting in sightings if sighting is not None]
    if not seen:
        raise CapacityError("no carrier is found in any frame")
    reference = max(seen, key=lambda sighting: len(sighting.descriptors))
    R, C, K = reference.soft.shape
    soft = np.zeros((len(sightings), R, C, K), dtype=reference.soft.dtype)
    placements = [Placement(np.full((R, C), np.nan), np.ones(C))] * len(sightings)
    for t, sighting in enumerate(sightings):
        if sighting is not None:
            own, theirs = _matched(sighting, reference, matcher)
            soft[t][:, theirs] = sighting.soft[:, own]
            if sighting.placement is not None:
                placements[t] = _moved(sighting.placement, own, theirs, C)
    placed = None if reference.placement is None else tuple(placements)
    return Aligned(soft, reference.log_prior, placed)


def _moved(placement: Placement, own: IntArray, theirs: IntArray, C: int) -> Placement:
    """Give carriers `own` of a placement the indices `theirs` among C; others are unknown."""
    everyone = np.arange(C)
    if np.array_equal(own, everyone) and np.array_equal(theirs, everyone):
        # The usual case, shared: of a long animation, copies would add up.
        return placement
    place = np.full((len(placement.place), C), np.nan)
    doubt = np.ones(C)
    place[:, theirs] = placement.place[:, own]
    doubt[theirs] = placement.doubt[own]
    return Placement(place, doubt)


def _matched(
    sighting: Sighting, reference: Sighting, matcher: Matcher
) -> tuple[IntArray, IntArray]:
    """Own carriers, and those of the reference that they are."""
    cost = matcher(sighting, reference)
    own, theirs = linear_sum_assignment(np.minimum(cost, _NEVER))
    possible = np.isfinite(cost[own, theirs])
    return own[possible], theirs[possible]
