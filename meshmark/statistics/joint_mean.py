"""The e-value of one key on several groups of carriers, where all draw from the same words.

Two groups may hold the same word, whose e-values on both then depend on each other. So the mean is
over the assignments in which no word is held twice, by whatever group: the words of one assignment
are independent, and the product of their e-values is an e-value. A word that two groups do hold
counts for one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, logsumexp

from meshmark.arrays import BoolArray, FloatArray, IntArray, SignArray
from meshmark.statistics.p_values import SCORES_AT_ONCE, log_null_of
from meshmark.statistics.window_mean import largest_terms
from meshmark.statistics.word_windows import (
    WINDOW_SIZE,
    WordPosterior,
    WordWindows,
    assignment_sums,
)


@dataclass(frozen=True, eq=False)
class Group:
    """Carriers that were measured under common hypotheses.

    Parameters
    ----------
    S : (R, C, K) float64
        Evidence under each of R hypotheses.
    log_prior : (R,) float64
        Log prior of each; the exponentials sum to at most 1.
    posterior : WordPosterior
        Which words carriers may hold.
    """

    S: FloatArray
    log_prior: FloatArray
    posterior: WordPosterior


def joint_log_e(groups: Sequence[Group], words: SignArray) -> FloatArray:
    """Log e-value of words (n, M, K) on all groups together, (n,).

    Notes
    -----
    The mark of some groups may be destroyed: each number of those that are left is as probable as
    another, and so are all choices of so many. Each group counts under the hypothesis, tilt and
    shift that fit a key best, with their prior, and groups are left out from the one that fits
    worst on. No term of a mean of e-values is negative, so that leaving the others out can only
    make the e-value smaller.
    """
    windows = [group.posterior.windows(words.shape[-2]) for group in groups]
    log_null = [log_null_of(group.S) for group in groups]
    size = WINDOW_SIZE * sum(group.S.shape[0] * group.S.shape[1] for group in groups)
    at_once = max(1, SCORES_AT_ONCE // size)
    found = []
    for start in range(0, len(words), at_once):
        some = words[start : start + at_once]
        chosen = [
            _Chosen.of(group, null, within, some)
            for group, null, within in zip(groups, log_null, windows, strict=True)
        ]
        found.append(_mean_over_those_left(chosen))
    return np.concatenate(found)


@dataclass(frozen=True, eq=False)
class _Chosen:
    """What fits each of n keys best on a group.

    Parameters
    ----------
    first : (n, C) int
        First word of each carrier's window.
    prior, e : (n, C, W) float64
        Prior of each word of the window, and its e-value.
    p_null : (n, C) float64
        Prior of none.
    log_weight : (n,) float64
        Log prior of the hypothesis, tilt and shift.
    log_e : (n,) float64
        Log e-value of the group by itself, with that prior.
    """

    first: IntArray
    prior: FloatArray
    e: FloatArray
    p_null: FloatArray
    log_weight: FloatArray
    log_e: FloatArray

    @classmethod
    def of(
        cls, group: Group, log_null: FloatArray, windows: WordWindows, words: SignArray
    ) -> _Chosen:
        terms = largest_terms(group.S, words, log_null, group.log_prior, windows)
        e, weight = terms.e[:, 0], terms.log_weight[:, 0]
        shift, hypothesis = terms.shift[:, 0], terms.hypothesis[:, 0]
        return cls(
            windows.first[hypothesis],
            windows.prior[shift, hypothesis],
            e,
            windows.p_null[hypothesis],
            weight,
            windows.log_mean(e, shift, hypothesis) + weight,
        )


def _mean_over_those_left(groups: Sequence[_Chosen]) -> FloatArray:
    """Average e-values over which groups are left, as far as they are the first by what fits."""
    rank = np.argsort(np.argsort([-group.log_e for group in groups], axis=0), axis=0).T
    first, prior, e, p_null = (
        np.concatenate([getattr(group, name) for group in groups], axis=1)
        for name in ("first", "prior", "e", "p_null")
    )
    weight = np.stack([group.log_weight for group in groups], axis=1)
    owner = np.repeat(np.arange(len(groups)), [group.first.shape[1] for group in groups])
    G = len(groups)
    terms = [np.full(len(first), -np.log(G + 1.0))]
    for n in range(1, G + 1):
        left = rank < n
        choices = gammaln(G + 1.0) - gammaln(n + 1.0) - gammaln(G - n + 1.0)
        log_mean = _log_mean(first, prior, e, p_null, left[:, owner])
        log_prior = np.where(left, weight, 0.0).sum(axis=1) - choices - np.log(G + 1.0)
        terms.append(log_mean + log_prior)
    return np.asarray(logsumexp(terms, axis=0))


def _log_mean(
    first: IntArray, prior: FloatArray, e: FloatArray, p_null: FloatArray, left: BoolArray
) -> FloatArray:
    """Average the e-values of some carriers over assignments that hold no word twice, (n,)."""
    scale = np.where(left, np.maximum(e.max(axis=-1), 1.0), 1.0)
    prior, p_null = np.where(left[..., None], prior, 0.0), np.where(left, p_null, 1.0)
    summed = assignment_sums(first, prior * (e / scale[..., None]), p_null / scale)
    total = assignment_sums(first, prior, p_null)
    with np.errstate(divide="ignore"):
        mean: FloatArray = np.log(summed) + np.log(scale).sum(axis=-1) - np.log(total)
    return mean
