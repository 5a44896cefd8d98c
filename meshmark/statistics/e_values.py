"""What the sums over readings, tilts and words are made of: e-values of single carriers."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray

# Soft chips lie in [-1, 1]. In steps of two, no best l in between is missed by more than the
# square root of two, and averaging over all eight costs log10(8) = 0.9 decades at the very most.
TILTS: FloatArray = 2.0 ** np.arange(-2.0, 6.0)

# Belief that a carrier was destroyed.
LOST = 0.15
# How many of all combinations are summed up, those that promise the most.
LIKELIEST = 8


def log_cosh(x: FloatArray) -> FloatArray:
    """Compute log cosh x without overflow."""
    a = np.abs(x)
    return a + np.log1p(np.exp(-2.0 * a)) - np.log(2.0)


def e_values(score: FloatArray, log_null: FloatArray, tilts: FloatArray) -> FloatArray:
    """Compute e-values of words on carriers that may have been destroyed, (..., T, C, M).

    Parameters
    ----------
    score : (..., 1, C, M) float64
        Sum of a word times a carrier's evidence.
    log_null : (..., T, C) float64
        Sum of log cosh of tilt times evidence.
    tilts : (T,) float64
        See `TILTS`.

    Returns
    -------
    (..., T, C, M) float64
        At most 2^K, so that hundreds of chips fit into a float.
    """
    log_e = tilts[:, None, None] * score
    log_e -= log_null[..., None]
    np.exp(log_e, out=log_e)
    log_e *= 1.0 - LOST
    log_e += LOST
    return log_e


def likeliest(promise: FloatArray) -> tuple[IntArray, ...]:
    """Find where most is promised in (n, ...): (n, `LIKELIEST`) indices along each axis."""
    flat = promise.reshape(len(promise), -1)
    chosen = np.argsort(-flat, axis=-1, kind="stable")[:, :LIKELIEST]
    return np.unravel_index(chosen, promise.shape[1:])
