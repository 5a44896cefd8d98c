"""From the heights that frames show to soft chips, estimated from all frames together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark_plugins.schemes.relief.basis import Basis

# Most iterations of the solver: the first round only serves to tell noise from chips.
ROUGH, FINE = 24, 24
TOLERANCE = 1e-3
# A soft chip is its estimate over so many root mean squares, so that few are cut.
CUT = 4.0
# Noise is at least this share of the height: what nobody touched is never exact.
LEAST_NOISE = 0.1
# Power of what is left of the chips, at least: in a mean of n copies it is 1 / n.
LEAST_POWER = 0.01
# Turns the median absolute deviation of a normal distribution into its standard deviation.
MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights above the vertices of a reference.

    Parameters
    ----------
    value : (N,) float64
        Mean height of the copy's vertices about each vertex; 0 where there are none.
    count : (N,) float64
        How many they are, shared among the corners of the triangle they lie on.
    deviation : float
        Standard deviation of the heights of the copy's vertices; inf if there are too few.
    """

    value: FloatArray
    count: FloatArray
    deviation: float


def soft_chips(basis: Basis, height: float, frames: Sequence[Heights]) -> FloatArray:
    """Estimate chips from the heights of all frames; each frame gets what it adds.

    Parameters
    ----------
    basis : Basis
        K chips on N vertices.
    height : float
        What the relief was multiplied by, A.
    frames : sequence of T Heights

    Returns
    -------
    (T, K) float64
        In [-1, 1]; 0 where nothing is known. Their mean over frames is the estimate from all.

    Notes
    -----
    The model of frame t is r_t = A B w + noise of variance sigma_t^2 / count, with chips w of
    variance P. The linear estimate of least mean square error is a sum over frames,
    w^ = (sum_t B' p_t B + 1 / P)^-1 sum_t B' p_t r_t / A, with p_t = count A^2 / sigma_t^2. It is
    kept linear: of what is left of each of many copies in their mean, the size of w^ tells more
    than its sign.
    """
    r = np.stack([frame.value for frame in frames], axis=1) / height
    count = np.stack([frame.count for frame in frames], axis=1)
    if not count.any():
        return np.zeros((len(frames), basis.n_chips))
    p = count / _variance(r, count)
    w = _solve(basis, p.sum(axis=1), 1.0, (p * r).sum(axis=1, keepdims=True), ROUGH)
    p = count / _variance(r - basis.heights(w), count)
    total = p.sum(axis=1)
    share = basis.squares(total) / (basis.squares(total) + 1.0)
    power = max(LEAST_POWER, float((w**2).sum() / share.sum()))
    parts = _solve(basis, total, power, p * r, FINE)
    rms = np.sqrt((parts**2).mean()) or 1.0
    return np.clip(parts.T / (CUT * rms), -1.0, 1.0)


def _variance(left: FloatArray, count: FloatArray) -> FloatArray:
    """Measure the variance of one vertex's noise from (N, T), by the median, (T,)."""
    scaled = np.where(count > 0.0, np.sqrt(count) * left, np.nan)
    seen = (count > 0.0).any(axis=0)
    sigma = np.full(count.shape[1], np.inf)
    middle = np.nanmedian(scaled[:, seen], axis=0)
    sigma[seen] = MAD_TO_SIGMA * np.nanmedian(np.abs(scaled[:, seen] - middle), axis=0)
    return np.maximum(sigma, LEAST_NOISE) ** 2


def _solve(
    basis: Basis, p: FloatArray, power: float, right: FloatArray, iterations: int
) -> FloatArray:
    """Solve (B' p B + 1 / power) w = B' right for columns (N, T), by conjugate gradients."""

    def apply(w: FloatArray) -> FloatArray:
        return basis.adjoint(p[:, None] * basis.heights(w)) + w / power

    preconditioner = 1.0 / (basis.squares(p) + 1.0 / power)[:, None]
    return _conjugate_gradients(apply, basis.adjoint(right), preconditioner, iterations)


def _conjugate_gradients(
    A: Callable[[FloatArray], FloatArray], b: FloatArray, M: FloatArray, iterations: int
) -> FloatArray:
    """Solve A x = b for columns b (K, T) at once, each by steps of its own.

    References
    ----------
    M. R. Hestenes, E. Stiefel, "Methods of conjugate gradients for solving linear systems", Journal
    of Research of the National Bureau of Standards 49(6), 1952. doi:10.6028/jres.049.044
    """
    x, r = np.zeros_like(b), b
    z = M * r
    d = z
    rz = (r * z).sum(axis=0)
    enough = TOLERANCE**2 * rz
    for _ in range(iterations):
        if np.all(rz <= enough):
            break
        Ad = A(d)
        curvature = (d * Ad).sum(axis=0)
        step = np.divide(rz, curvature, out=np.zeros_like(rz), where=curvature > 0.0)
        x, r = x + step * d, r - step * Ad
        z = M * r
        before, rz = rz, (r * z).sum(axis=0)
        d = z + np.divide(rz, before, out=np.zeros_like(rz), where=before > 0.0) * d
    return x
