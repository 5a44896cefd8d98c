"""Evidence of several meshes of one asset, put together: what each says weakly, all say strongly.

A key has the same words for all meshes of an asset. E-values of two meshes may therefore be
multiplied only where the meshes are taken to hold different words. Where they hold the same words,
their evidence is summed, carrier by carrier: a sum of signed numbers that were measured without the
key is again one, however the meshes depend on each other. Only `Pool.log10_p` involves a key.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import comb, logsumexp

from meshmark.arrays import FloatArray, IntArray, SignArray
from meshmark.detection.carrier_matching import agreement
from meshmark.detection.evidence import Evidence, RestoredVariant
from meshmark.statistics.e_values import N_TOP_TERMS
from meshmark.statistics.joint_mean import Group, joint_log_e
from meshmark.statistics.p_values import log10_p_words, reachable_log10_p, word_log_e_means
from meshmark.statistics.screening import Screen, Screened

# Share of a scheme's rate that its pools have, where there are any; its meshes have the rest.
POOLED_SHARE = 0.5
# Groups of meshes whose words are tried on all of them together: those that tell most.
MOST_GROUPS = 16
# Meshes are alike if so large a share of their carriers pair up, places in the list of words no
# farther apart than this, under hypotheses whose log priors differ by no more than this.
PAIRED, APART, UNLIKE = 0.75, 1.5, 0.5
# Worth of agreeing evidence beside a step between places: left and right lie in one place.
AGREEMENT = 2.0
_SURFACE = re.compile(r"surface \d+")
# What a run of frames is called where the connectivity of a mesh changes: `meshmark.mesh.runs`.
_RUN = re.compile(r"frames \S+:\S+")
# Stands for "out of the question" in sums that must stay finite.
_NEVER = 1e6


@dataclass(frozen=True, eq=False)
class Pool:
    """Several meshes, or surfaces of meshes, of one asset by one scheme.

    Parameters
    ----------
    evidence : tuple of Evidence
        What each of them says.
    """

    evidence: tuple[Evidence, ...]

    @property
    def scheme(self) -> str:
        """The scheme that measured them."""
        return self.evidence[0].scheme

    @property
    def n_words(self) -> int:
        """Code words of that scheme."""
        return self.evidence[0].n_words

    @property
    def n_chips(self) -> int:
        """Chips of the longest word."""
        return max(item.n_chips for item in self.evidence)

    @cached_property
    def shared(self) -> tuple[FloatArray, FloatArray]:
        """Evidence (R, K) of all where they share one word, and log belief (R,)."""
        return _sum_of_shared(self.evidence, self.n_chips)

    @cached_property
    def variants(self) -> list[tuple[float, list[Group]]]:
        """Evidence of each group of meshes that hold the same words, and log belief, by variant."""
        groups = _alike(self.evidence)
        found = []
        for first in groups[0][0].variants:
            under = [_under(group, first.restored) for group in groups]
            found.append((first.log_belief, [group for group in under if group is not None]))
        return found

    def log10_p(self, words: SignArray) -> FloatArray:
        """Bound log10 of the probability that random words (n, M, K) fit all as well, (n,)."""
        return np.minimum(0.0, self.unlimited_log10_p(words))

    def unlimited_log10_p(self, words: SignArray) -> FloatArray:
        """Bound it as `log10_p` does; above 0 where even 1 is too low a bound."""
        if self.n_words == 1:
            S, belief = self.shared
            return log10_p_words(S[:, None], words, belief)
        each = [log_belief + _log_e(groups, words) for log_belief, groups in self.variants]
        return -np.asarray(logsumexp(each, axis=0)) / np.log(10.0)

    @cached_property
    def screens(self) -> list[tuple[float, list[Screen]]]:
        """Quick bounds on what words may say of each group, and log belief, by variant."""
        return [
            (
                log_belief,
                [
                    Screen([Screened(g.S, g.log_prior, g.posterior)], self.n_words, -np.inf)
                    for g in groups[:MOST_GROUPS]
                ],
            )
            for log_belief, groups in self.variants
        ]

    def log_e_bounds(self, words: SignArray) -> FloatArray:
        """Bound the log e-value of words (n, M, K), which are not shared, from above, (n,).

        A mean over how many groups are left is at most its largest term: the product over those
        that are worth most, over the number of such choices. Of a group, one term counts.
        """
        total = np.full(len(words), -np.inf)
        for log_belief, screens in self.screens:
            each = [screen.log_e_bounds(words[:, screen.words]) for screen in screens]
            best = -np.sort(-np.array(each), axis=0)
            if len(screens) > 1:
                left = np.arange(1, len(screens) + 1)
                choices = np.log(comb(len(screens), left))[:, None]
                sums = np.cumsum(best - np.log(N_TOP_TERMS), axis=0) - choices
                best = np.maximum(0.0, sums)
            total = np.logaddexp(total, log_belief + best.max(axis=0))
        return total

    @cached_property
    def reachable_log10_p(self) -> float:
        """Lowest log10 p that the best of keys could reach on as many chips."""
        if self.n_words == 1:
            return reachable_log10_p(np.any(self.shared[0] != 0.0, axis=0, keepdims=True), 1)
        # A word of which two could tell is counted twice: too low a bound, which is no harm.
        return sum(item.reachable_log10_p for item in (group[0] for group in _alike(self.evidence)))


def pools(evidence: Sequence[Evidence]) -> list[Pool]:
    """List what of an asset is judged together: all meshes, and all surfaces of meshes.

    A mesh whose connectivity changes is as many meshes as it has runs of frames.

    Parameters
    ----------
    evidence : sequence of Evidence
        Of the meshes and parts of an asset, by one scheme.

    Returns
    -------
    list of Pool
        None if fewer than two of them hold chips.
    """
    held = [item for item in evidence if item.held.any() and _can_be_pooled(item)]
    runs = [item for item in held if _RUN.fullmatch(item.part)]
    changing = {item.prim for item in runs}
    meshes = [*(item for item in held if not item.part and item.prim not in changing), *runs]
    surfaces = [item for item in held if _SURFACE.fullmatch(item.part)]
    apart = {prim for item in surfaces for prim in (item.prim, *item.also)}
    whole = [item for item in meshes if item.prim not in apart]
    distinct = [meshes, [*whole, *surfaces]] if surfaces else [meshes]
    return [Pool(tuple(items)) for items in distinct if len(items) > 1]


def _can_be_pooled(item: Evidence) -> bool:
    return item.n_words == 1 or item.variants[0].posterior is not None


def _sum_of_shared(items: Sequence[Evidence], n_chips: int) -> tuple[FloatArray, FloatArray]:
    """Sum the evidence of meshes whose carriers all share one word.

    Chip k is the same sign in all of them. Meshes that have as many hypotheses have the same ones.
    Otherwise those that tell of the same chips are put together first.
    """
    each = [(v.pooled.sum(axis=1), v.belief) for v in (item.variants[0] for item in items)]
    if len({len(S) for S, _ in each}) > 1:
        each = [_by_chips_told(*one) for one in each]
        most = max(len(S) for S, _ in each)
        each = [(S, belief) for S, belief in each if len(S) == most]
    total = np.zeros((len(each[0][0]), n_chips))
    for S, _ in each:
        total[:, : S.shape[1]] += S
    return total / len(each), each[0][1]


def _by_chips_told(S: FloatArray, belief: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Put hypotheses together that tell of the same chips: their mean, and all their belief."""
    _, first, kind = np.unique(S != 0.0, axis=0, return_index=True, return_inverse=True)
    of_kind = np.eye(len(first))[kind.reshape(-1)][:, np.argsort(first)].T
    share = of_kind * np.exp(belief)
    total = share.sum(axis=1, keepdims=True)
    return share @ S / total, np.log(total[:, 0])


def _alike(items: Sequence[Evidence]) -> list[list[Evidence]]:
    """Group the meshes whose carriers may hold the same words, those that tell most first."""
    groups: list[list[Evidence]] = []
    for item in sorted(items, key=lambda item: item.reachable_log10_p):
        for group in groups:
            if _paired(item.variants[0], group[0].variants[0]) is not None:
                group.append(item)
                break
        else:
            groups.append([item])
    return groups


def _paired(own: RestoredVariant, first: RestoredVariant) -> tuple[IntArray, IntArray] | None:
    """Pair the carriers of two meshes that may hold the same words; None if they are not alike."""
    if own.shape[1] != first.shape[1] or own.shape[3] != first.shape[3]:
        return None
    if np.abs(own.belief - first.belief).max() > UNLIKE:
        return None
    assert own.posterior is not None
    assert first.posterior is not None
    best = int(np.argmax(first.belief))
    gap = np.abs(own.posterior.position[best][:, None] - first.posterior.position[best])
    possible = gap <= APART
    cost = gap + AGREEMENT * (1.0 - agreement(own.pooled[best], first.pooled[best]))
    rows, columns = linear_sum_assignment(np.where(possible, cost, _NEVER))
    kept = possible[rows, columns]
    return (rows[kept], columns[kept]) if kept.sum() >= PAIRED * max(gap.shape) else None


def _under(group: Sequence[Evidence], restored: int) -> Group | None:
    """Sum the evidence of meshes that are alike under one variant, by carriers of the first."""
    variants = [v for item in group for v in item.variants if v.restored == restored]
    if not variants:
        return None
    first, *others = variants
    assert first.posterior is not None
    total, n = first.pooled.copy(), 1
    for other in others:
        pairs = _paired(other, first)
        if pairs is not None:
            total[:, pairs[1]] += other.pooled[:, pairs[0]]
            n += 1
    return Group(total / n, first.log_prior, first.posterior)


def _log_e(groups: Sequence[Group], words: SignArray) -> FloatArray:
    """Log e-value of words (n, M, K) on groups of meshes, (n,)."""
    if len(groups) == 1:
        [only] = groups
        return word_log_e_means(only.S, only.log_prior, words, only.posterior)
    return joint_log_e(groups[:MOST_GROUPS], words)
