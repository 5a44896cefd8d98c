"""E-values of words on single carriers, of which all means over hypotheses are made."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray

# Exponential tilts l. Soft chips lie in [-1, 1]. In steps of two, no best l in between is missed by
# more than the square root of two, and averaging over all eight costs log10(8) = 0.9 decades at
# the very most.
TILTS: FloatArray = 2.0 ** np.arange(-2.0, 6.0)

# Prior probability that a carrier was destroyed, and says nothing of the word it held.
P_DESTROYED = 0.15
# Terms of a mean that are summed up: the largest ones, as far as they can be told beforehand.
N_TOP_TERMS = 8


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
        `P_DESTROYED` + (1 - `P_DESTROYED`) exp(tilt score) / prod cosh: a mixture of the e-value 1
        and of that in `meshmark.statistics.p_values`. At most 2^K, so that hundreds of chips fit
        into a float.
    """
    log_e = tilts[:, None, None] * score
    log_e -= log_null[..., None]
    np.exp(log_e, out=log_e)
    log_e *= 1.0 - P_DESTROYED
    log_e += P_DESTROYED
    return log_e


def top_terms(approximate: FloatArray) -> tuple[IntArray, ...]:
    """Find the largest of terms (n, ...): (n, `N_TOP_TERMS`) indices along each axis."""
    flat = approximate.reshape(len(approximate), -1)
    chosen = np.argsort(-flat, axis=-1, kind="stable")[:, :N_TOP_TERMS]
    return np.unravel_index(chosen, approximate.shape[1:])
