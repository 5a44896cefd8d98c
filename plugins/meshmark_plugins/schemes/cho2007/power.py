"""The power map u -> u^k, which shifts the mean of numbers in [0, 1] and keeps their order."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray

# k from 1/256 to 256: beyond, every number but 0 and 1 is as good as at an end.
MAX_LOG_EXPONENT = np.log(256.0)
BISECTION_STEPS = 50


def exponents(u: FloatArray, bins: IntArray, target: FloatArray) -> FloatArray:
    """Find the exponent that gives each bin the mean it should have.

    Parameters
    ----------
    u : (n,) float64
        Numbers in [0, 1].
    bins : (n,) int
        Bin of each, 0 to K - 1.
    target : (K,) float64
        Mean each bin should get.

    Returns
    -------
    (K,) float64
        k of each bin: below 1 raises the mean, above 1 lowers it. Where no k reaches the
        target, the nearest end of the range, [1/256, 256].

    Notes
    -----
    The mean falls with k, so that the paper's search in steps of k becomes a bisection of
    log k, of all bins at once.
    """
    K = len(target)
    count = np.maximum(np.bincount(bins, minlength=K), 1)
    with np.errstate(divide="ignore"):
        log_u = np.log(u)
    low, high = np.full(K, -MAX_LOG_EXPONENT), np.full(K, MAX_LOG_EXPONENT)
    for _ in range(BISECTION_STEPS):
        middle = (low + high) / 2.0
        mean = np.bincount(bins, np.exp(np.exp(middle)[bins] * log_u), K) / count
        too_high = mean > target
        low, high = np.where(too_high, middle, low), np.where(too_high, high, middle)
    return np.exp((low + high) / 2.0)
