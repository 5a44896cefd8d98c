"""Which carrier of one frame is which of another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from meshmark.arrays import FloatArray, IntArray
from meshmark.detection.evidence import FrameEvidence, Made
from meshmark.errors import CapacityError
from meshmark.extension.carrier import Sighting
from meshmark.statistics.word_windows import Placement

# (own sighting, reference sighting) -> cost (C, D) of matching own carriers with those of the
# reference; inf where a match is out of the question.
Matcher = Callable[[Sighting, Sighting], FloatArray]

# Farthest that a tip may wander over the surface between two poses, as a share of the diagonal.
WANDER = 0.05
# Frames among which the one that sets the order is chosen.
SAMPLED = 16
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
    frames : sequence of T FrameEvidence
        Evidence in the type it was given; a carrier missing from a frame is all erasures there.
        Made from the sightings when asked for.
    log_prior : (R,) float64
        Log belief in each reading.
    """

    frames: Sequence[FrameEvidence]
    log_prior: FloatArray


def aligned(sightings: Sequence[Sighting | None], matcher: Matcher) -> Aligned:
    """Put the carriers of every frame into the order of one that most others agree with.

    Carriers are matched one to one, at the least total cost. That needs no key, so a wrong
    match costs evidence but never honesty. The frame is the one whose carriers find the most
    counterparts in the others, of equals the one that shows the most, then the first.

    Parameters
    ----------
    sightings : sequence of T Sighting or None
        They may be many, and are asked for one at a time.

    Raises
    ------
    CapacityError
        If no frame shows any carrier.
    """
    sizes = [-1 if sighting is None else len(sighting.descriptors) for sighting in sightings]
    if max(sizes, default=-1) < 0:
        raise CapacityError("no carrier is found in any frame")
    reference = _most_matched(sightings, sizes, matcher)
    matches = [
        None if sighting is None else _matched(sighting, reference, matcher)
        for sighting in sightings
    ]
    silent = _silence(reference)

    def frame(index: int) -> FrameEvidence:
        sighting, match = sightings[index], matches[index]
        return silent if sighting is None or match is None else _moved(sighting, *match, silent)

    return Aligned(Made(frame, len(sightings)), reference.log_prior)


def _most_matched(
    sightings: Sequence[Sighting | None], sizes: Sequence[int], matcher: Matcher
) -> Sighting:
    """Choose the sighting whose carriers are found most often in the others, among some."""
    shown = [index for index, size in enumerate(sizes) if size >= 0]
    places = np.linspace(0, len(shown) - 1, min(len(shown), SAMPLED)).round().astype(int)
    asked = {shown[place] for place in places} | {int(np.argmax(sizes))}
    ordered = sorted(asked, key=lambda index: (-sizes[index], index))
    some = [sighting for sighting in (sightings[index] for index in ordered) if sighting]
    found = [sum(_matched(own, other, matcher)[0].size for own in some) for other in some]
    return some[int(np.argmax(found))]


def _silence(sighting: Sighting) -> FrameEvidence:
    """Evidence of a frame that shows none of a sighting's carriers."""
    R, C, _ = sighting.soft.shape
    unknown = Placement(np.full((R, C), np.nan), np.ones(C))
    return FrameEvidence(
        np.zeros_like(sighting.soft), None if sighting.placement is None else unknown
    )


def _moved(
    sighting: Sighting, own: IntArray, theirs: IntArray, silent: FrameEvidence
) -> FrameEvidence:
    """Give a sighting's carriers `own` the indices `theirs`; of others, nothing is known."""
    steps = silent.steps.copy()
    steps[:, theirs] = sighting.soft[:, own]
    if silent.placement is None or sighting.placement is None:
        return FrameEvidence(steps, silent.placement)
    place, doubt = silent.placement.place.copy(), silent.placement.doubt.copy()
    place[:, theirs] = sighting.placement.place[:, own]
    doubt[theirs] = sighting.placement.doubt[own]
    return FrameEvidence(steps, Placement(place, doubt))


def _matched(
    sighting: Sighting, reference: Sighting, matcher: Matcher
) -> tuple[IntArray, IntArray]:
    """Own carriers, and those of the reference that they are."""
    cost = matcher(sighting, reference)
    own, theirs = linear_sum_assignment(np.minimum(cost, _NEVER))
    possible = np.isfinite(cost[own, theirs])
    return own[possible], theirs[possible]
