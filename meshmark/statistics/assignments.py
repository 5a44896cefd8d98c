"""Which carrier holds which code word: multiple testing that is corrected by averaging."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import logsumexp

from meshmark.arrays import FloatArray, IntArray

# How strongly assignments keep the order in which carriers and words are listed; a quarter of the
# prior each. It falls by exp(-k) with every place that a carrier is away from its word's, so that
# 0 prefers no order. The last quarter is for assignments that keep the order alone: where
# carriers were lost, or false ones joined, the others have other places.
ORDER_DECAYS = (0.0, 1.0, 3.0)
# Prior of a false carrier, relative to one that holds a word, where order is kept.
FALSE_CARRIER_WEIGHT = 0.3


def mean_over_assignments(log_e: FloatArray) -> FloatArray:
    """Log of the mean of prod e[c, word of c] over all assignments of words to carriers.

    Words are given out in their order: with G of them, the first G are in use, each on a
    carrier of its own. The prior of G falls by half with every step away from the number of
    carriers found. Words of a random key are independent, so that the product for one assignment
    is an e-value; a carrier that holds no word contributes 1; and means of e-values are e-values.

    Parameters
    ----------
    log_e : (..., C, M) float64
        Log e-value of word m on carrier c.

    Returns
    -------
    (...) float64

    Notes
    -----
    The sums are permanents. A dynamic program over the subsets of used words takes C M 2^M
    steps, done here for all leading axes at once, on e-values scaled so that none exceeds 1.
    """
    *_, C, M = log_e.shape
    scale = np.maximum(log_e.max(axis=-1, keepdims=True), 0.0)
    e, idle = np.exp(log_e - scale), np.exp(-scale[..., 0])
    means = [_ordered_mean(e, idle)]
    for k in ORDER_DECAYS:
        weights, log_weight_sums = _order_weights(C, M, k)
        with np.errstate(divide="ignore"):
            log_table = np.log(_subset_sums(e * weights, idle))
        means.append(_sums_over_counts(log_table, C, M, log_weight_sums))
    mean: FloatArray = logsumexp(np.array(means), axis=0) - np.log(len(means))
    return mean + scale.sum(axis=(-2, -1))


def _ordered_mean(e: FloatArray, idle: FloatArray) -> FloatArray:
    """Log of the mean over the assignments that keep the order, over the counts of words.

    The factors, here and below: `e` (..., C, M) of word m on carrier c, `idle` (..., C) of a
    carrier without a word.
    """
    *_, C, M = e.shape
    counts = _ordered_sums(np.ones((C, M)), np.ones(C))
    with np.errstate(divide="ignore"):
        log_means = np.log(_ordered_sums(e, idle)) - np.log(counts)
    return logsumexp(log_means + _log_count_priors(C, M), axis=-1)


def _ordered_sums(e: FloatArray, idle: FloatArray) -> FloatArray:
    """Sum over the assignments that keep the order, with the first 1, 2, ... M words, (..., M).

    A carrier may be false, at a prior of `FALSE_CARRIER_WEIGHT`; any word may be missing.
    """
    *lead, C, M = e.shape
    sums = np.ones((*lead, M + 1))
    for c in range(C):
        # Word m goes to this carrier, words before it to earlier ones; summed over m.
        joined = np.cumsum(sums[..., :-1] * e[..., c, :], axis=-1)
        sums = sums * (FALSE_CARRIER_WEIGHT * idle[..., c, None])
        sums[..., 1:] += joined
    return sums[..., 1:]


@lru_cache(maxsize=64)
def _order_weights(C: int, M: int, k: float) -> tuple[FloatArray, FloatArray]:
    """Prior of word m on carrier c, (C, M), and the log of its sums for 1, 2, ... M words."""
    weights = np.exp(-k * np.abs(np.arange(C)[:, None] - np.arange(M)))
    with np.errstate(divide="ignore"):
        log_table = np.log(_subset_sums(weights, np.ones(C)))
    sums = [logsumexp(log_table[_used(min(C, G), G, M)]) for G in range(1, M + 1)]
    return weights, np.array(sums)


def _sums_over_counts(
    log_table: FloatArray, C: int, M: int, log_weight_sums: FloatArray
) -> FloatArray:
    """Average over the number of words in use, each number's sum over its weights' sum."""
    terms = [
        logsumexp(log_table[..., _used(min(C, G), G, M)], axis=-1)
        - log_weight_sums[G - 1]
        + log_prior
        for G, log_prior in enumerate(_log_count_priors(C, M), start=1)
    ]
    return logsumexp(np.array(terms), axis=0)


def _log_count_priors(C: int, M: int) -> FloatArray:
    """Log prior that 1, 2, ... M words are in use when C carriers were found."""
    prior = 0.5 ** np.abs(np.arange(1, M + 1) - min(C, M))
    return np.log(prior / prior.sum())


def _subset_sums(e: FloatArray, idle: FloatArray) -> FloatArray:
    """Sum the products over all ways to give just a subset of the words to carriers, (..., 2^M)."""
    *lead, C, M = e.shape
    # Leading axes last: every step then runs along memory.
    e = np.moveaxis(e.reshape(-1, C, M), 0, -1)
    idle = np.moveaxis(idle.reshape(-1, C), 0, -1)
    table = np.zeros((1 << M, e.shape[-1]))
    table[0] = 1.0
    for c in range(C):
        table = with_carrier(table, e[c], idle[c])
    return table.T.reshape(*lead, 1 << M)


def with_carrier(table: FloatArray, e: FloatArray, idle: FloatArray) -> FloatArray:
    """Add a carrier to sums (2^M, n) over the subsets of M words in use.

    It takes any word that is free, by the factors `e` (M, n), or none, by `idle` (n,).
    """
    M, n = e.shape
    grown = table * idle
    for m in range(M):
        # Subsets by their higher words, whether word m is among them, their lower words.
        halves = (1 << (M - m - 1), 2, 1 << m, n)
        grown.reshape(halves)[:, 1] += table.reshape(halves)[:, 0] * e[m]
    return grown


def _used(n_used: int, n_given: int, M: int) -> IntArray:
    """Subsets of `n_used` of the first `n_given` of M words, as bit masks."""
    masks = np.arange(1 << M)
    return masks[(np.bitwise_count(masks) == n_used) & (masks < (1 << n_given))]
