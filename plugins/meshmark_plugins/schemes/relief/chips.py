"""From the heights a copy shows to soft chips: how each chip stands, and how sure that is."""

from __future__ import annotations

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from meshmark.arrays import FloatArray
from meshmark_plugins.schemes.relief.basis import Basis

# Rounds in which the noise is measured again, without the chips found so far.
ROUNDS = 2
ITERATIONS = 24
TOLERANCE = 1e-3
# Half the logarithm of a likelihood ratio that counts as certain.
CERTAIN = 3.0
LEAST_POWER = 0.01
# Noise is at least this share of the height: what nobody touched is never exact.
LEAST_NOISE = 0.1
# Turns the median absolute deviation of a normal distribution into its standard deviation.
MAD_TO_SIGMA = 1.4826


def soft_chips(basis: Basis, height: float, r: FloatArray, count: FloatArray) -> FloatArray:
    """Estimate chips from heights, each by all vertices that tell of it.

    Parameters
    ----------
    basis : Basis
        K chips on N vertices.
    height : float
        What the relief was multiplied by, A.
    r : (N,) float64
        Height of the copy above the reference.
    count : (N,) float64
        How many of the copy's vertices each height is the mean of; 0 where there is none.

    Returns
    -------
    (K,) float64
        In [-1, 1]; 0 where nothing is known.

    Notes
    -----
    The model is r = A B w + noise of variance sigma^2 / count, w of variance 1. The linear
    estimate of least mean square error is w^ = (B' C B + lambda)^-1 B' C r / A with
    lambda = sigma^2 / A^2; a chip of which the share g is known, by its diagonal entry
    b / (b + lambda), has the log likelihood ratio 2 w^ / (1 - g).
    """
    known = count > 0.0
    if not known.any():
        return np.zeros(basis.n_chips)
    information = basis.squares(count)
    right = basis.adjoint(count * r) / height
    power = 1.0
    sigma, w = _noise(r[known], count[known], height), np.zeros(basis.n_chips)
    for _ in range(ROUNDS):
        lam = (sigma / height) ** 2 / power
        w = _solve(basis, count, lam, right, information)
        left = (r - height * basis.heights(w))[known]
        sigma = _noise(left, count[known], height)
        share = information / (information + lam)
        power = max(LEAST_POWER, float((w**2).sum() / (share).sum()))
    if not w.any():
        return w
    rms = np.sqrt((w**2).sum() / share.sum())
    return np.clip(w / (CERTAIN * rms), -1.0, 1.0)


def _solve(
    basis: Basis, count: FloatArray, lam: float, right: FloatArray, information: FloatArray
) -> FloatArray:
    n = basis.n_chips
    A = LinearOperator(
        (n, n), lambda w: basis.adjoint(count * basis.heights(w)) + lam * w, dtype=np.float64
    )
    preconditioner = 1.0 / (information + lam)
    M = LinearOperator((n, n), lambda x: preconditioner * x, dtype=np.float64)
    return cg(A, right, rtol=TOLERANCE, maxiter=ITERATIONS, M=M)[0]


def _noise(left: FloatArray, count: FloatArray, height: float) -> float:
    """Measure the standard deviation of one vertex's noise, by the median."""
    deviation = np.median(np.sqrt(count) * np.abs(left - np.median(left)))
    return max(MAD_TO_SIGMA * float(deviation), LEAST_NOISE * height)
