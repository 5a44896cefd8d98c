"""Which carrier of one frame is which of another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from meshmark.arrays import FloatArray, IntArray
from meshmark.detection.evidence import FrameEvidence, LazySequence
from meshmark.errors import CapacityError
from meshmark.extension.carrier import Observation
from meshmark.statistics.word_windows import WordPosterior

# (own observation, reference observation) -> cost (C, D) of matching own carriers with those of the
# reference; inf where a match is out of the question.
Matcher = Callable[[Observation, Observation], FloatArray]

# Farthest that a tip may wander over the surface between two poses, as a share of the diagonal.
WANDER = 0.05
# Frames among which the one that sets the order is chosen.
SAMPLED = 16
# Worth of agreeing evidence beside agreeing shapes.
AGREEMENT = 0.1
# Stands for "out of the question" in sums that must stay finite.
_NEVER = 1e6


def in_order(own: Observation, reference: Observation) -> FloatArray:
    """Match carriers by their order, which a common layout fixes."""
    return np.where(np.eye(len(own.descriptors), len(reference.descriptors)) > 0, 0.0, np.inf)


def by_place(points: FloatArray) -> Matcher:
    """Match carriers whose vertices lie near each other on one frame, `points` (N, 3)."""
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0

    def cost(own: Observation, reference: Observation) -> FloatArray:
        assert own.vertices is not None
        assert reference.vertices is not None
        gap = cdist(points[own.vertices], points[reference.vertices]) / (WANDER * diagonal)
        return np.where(gap <= 1.0, gap, np.inf)

    return cost


def by_looks(own: Observation, reference: Observation) -> FloatArray:
    """Match carriers alike in shape and in what they say.

    Left and right of a symmetric body have the same shape, but not the same evidence: what a
    carrier says in one frame, the same carrier says in the next, mark and mesh alike.
    """
    shape = cdist(own.descriptors, reference.descriptors)
    soft, of_reference = (each.soft[0].astype(np.float64) for each in (own, reference))
    return shape + AGREEMENT * (1.0 - agreement(soft, of_reference))


def agreement(S: FloatArray, reference: FloatArray) -> FloatArray:
    """Correlation of the evidence (C, K) of each carrier with that (D, K) of each other."""
    S = S / np.maximum(np.linalg.norm(S, axis=1, keepdims=True), 1e-12)
    reference = reference / np.maximum(np.linalg.norm(reference, axis=1, keepdims=True), 1e-12)
    return S @ reference.T


@dataclass(frozen=True, eq=False)
class Aligned:
    """Observations of several frames, their carriers in one order.

    Parameters
    ----------
    frames : sequence of T FrameEvidence
        Evidence in the type it was given; a carrier missing from a frame is all erasures there.
        Made from the observations whenever a frame is read.
    log_prior : (R,) float64
        Log belief in each hypothesis.
    """

    frames: Sequence[FrameEvidence]
    log_prior: FloatArray


def aligned(observations: Sequence[Observation | None], matcher: Matcher) -> Aligned:
    """Put the carriers of every frame into the order of one that most others agree with.

    Carriers are matched one to one, at the least total cost. That needs no key, so a wrong
    match costs evidence but never honesty. The frame is the one whose carriers find the most
    counterparts in the others, of equals the one that shows the most, then the first.

    Parameters
    ----------
    observations : sequence of T Observation or None
        They may be many, and are read one at a time.

    Raises
    ------
    CapacityError
        If no frame shows any carrier.
    """
    sizes = [
        -1 if observation is None else len(observation.descriptors) for observation in observations
    ]
    if max(sizes, default=-1) < 0:
        raise CapacityError("no carrier is found in any frame")
    reference = _most_matched(observations, sizes, matcher)
    matches = [
        None if observation is None else _matched(observation, reference, matcher)
        for observation in observations
    ]
    silent = _silence(reference)

    def frame(index: int) -> FrameEvidence:
        observation, match = observations[index], matches[index]
        return (
            silent if observation is None or match is None else _moved(observation, *match, silent)
        )

    return Aligned(LazySequence(frame, len(observations)), reference.log_prior)


def _most_matched(
    observations: Sequence[Observation | None], sizes: Sequence[int], matcher: Matcher
) -> Observation:
    """Choose the observation whose carriers are found most often in the others, among some."""
    shown = [index for index, size in enumerate(sizes) if size >= 0]
    places = np.linspace(0, len(shown) - 1, min(len(shown), SAMPLED)).round().astype(int)
    sampled = {shown[place] for place in places} | {int(np.argmax(sizes))}
    ordered = sorted(sampled, key=lambda index: (-sizes[index], index))
    some = [
        observation for observation in (observations[index] for index in ordered) if observation
    ]
    n_matched = [sum(_matched(own, other, matcher)[0].size for own in some) for other in some]
    return some[int(np.argmax(n_matched))]


def _silence(observation: Observation) -> FrameEvidence:
    """Evidence of a frame that shows none of an observation's carriers."""
    R, C, _ = observation.soft.shape
    unknown = WordPosterior(np.full((R, C), np.nan), np.ones(C))
    return FrameEvidence(
        np.zeros_like(observation.soft), None if observation.posterior is None else unknown
    )


def _moved(
    observation: Observation, own: IntArray, theirs: IntArray, silent: FrameEvidence
) -> FrameEvidence:
    """Give an observation's carriers `own` the indices `theirs`; of others, nothing is known."""
    steps = silent.steps.copy()
    steps[:, theirs] = observation.soft[:, own]
    if silent.posterior is None or observation.posterior is None:
        return FrameEvidence(steps, silent.posterior)
    place, p_null = silent.posterior.position.copy(), silent.posterior.p_null.copy()
    place[:, theirs] = observation.posterior.position[:, own]
    p_null[theirs] = observation.posterior.p_null[own]
    return FrameEvidence(steps, WordPosterior(place, p_null))


def _matched(
    observation: Observation, reference: Observation, matcher: Matcher
) -> tuple[IntArray, IntArray]:
    """Own carriers, and those of the reference that they are."""
    cost = matcher(observation, reference)
    own, theirs = linear_sum_assignment(np.minimum(cost, _NEVER))
    possible = np.isfinite(cost[own, theirs])
    return own[possible], theirs[possible]
