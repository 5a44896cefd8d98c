"""From the heights that frames show to soft chips, estimated from all frames together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark_plugins.schemes.relief.basis import Basis
from meshmark_plugins.schemes.relief.noise import SmoothNoise

# Most iterations of the solver, and the share of the residual at which it stops.
ITERATIONS, TOLERANCE = 24, 1e-3
# A soft chip is its estimate over so many root mean squares, so that few are cut.
CUT = 4.0
# Noise is at least this share of the height: what nobody touched is never exact.
LEAST_NOISE = 0.1
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
    scatter : (N,) float64
        Variance of that mean, where one vertex's height has the variance 1.
    deviation : float
        Standard deviation of the heights of the copy's vertices; inf if there are too few.
    """

    value: FloatArray
    count: FloatArray
    scatter: FloatArray
    deviation: float

    @classmethod
    def of_nothing(cls, n_points: int) -> Heights:
        """Say that nothing lies on the reference."""
        return cls(np.zeros(n_points), np.zeros(n_points), np.ones(n_points), np.inf)


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
    The model of frame t is r_t = A B w + noise, with chips w of variance 1, and noise of variance
    sigma_t^2 in the height of one vertex. The linear estimate of least mean square error is a sum
    over frames, w^ = (sum_t B' p_t B + 1)^-1 sum_t B' p_t r_t / A, where
    p_t = A^2 count / sigma_t^2.
    It is kept linear: of what is left of each of many copies in their mean, the size of w^ tells
    more than its sign. The variance of noise is that of the heights, less what a first estimate
    explains. What that leaves over would be less: with fewer vertices than chips, it fits noise.
    """
    r = np.stack([frame.value for frame in frames], axis=1) / height
    count = np.stack([frame.count for frame in frames], axis=1)
    if not count.any():
        return np.zeros((len(frames), basis.n_chips))
    variance = np.array([_variance(frame) for frame in frames]) / height**2
    p = count / np.maximum(variance, LEAST_NOISE**2)
    f = basis.heights(_solve(basis, p.sum(axis=1), (p * r).sum(axis=1, keepdims=True))[:, 0])
    explained = np.average(f**2, weights=count.sum(axis=1))
    p = count / np.maximum(variance - explained, LEAST_NOISE**2)
    return _cut(_solve(basis, p.sum(axis=1), p * r))


def soft_chips_in(
    noise: SmoothNoise, basis: Basis, height: float, frames: Sequence[Heights]
) -> FloatArray:
    """Estimate chips from heights with smooth noise that is the same in all frames.

    As `soft_chips`, with the mean r of the heights over all frames instead: noise that is the same
    in all of them does not become less by more frames. w^ = (B' P B + 1)^-1 B' P r / A, with the
    precision P of the noise. Heights that are not known are taken for 0.
    """
    r = np.stack([frame.value * frame.count for frame in frames], axis=1) / height
    count = np.sum([frame.count for frame in frames], axis=0)
    if not count.any():
        return np.zeros((len(frames), basis.n_chips))
    r /= np.where(count > 0.0, count, 1.0)[:, None]
    mean = r.sum(axis=1)[count > 0.0]
    median = np.median(mean)
    variance = (MAD_TO_SIGMA * float(np.median(np.abs(mean - median)))) ** 2 - 1.0
    variance = max(variance, LEAST_NOISE)

    def apply(w: FloatArray) -> FloatArray:
        return basis.adjoint(noise.precision(basis.heights(w))) / variance + w

    right = basis.adjoint(noise.precision(r)) / variance
    return _cut(_conjugate_gradients(apply, right, np.ones((basis.n_chips, 1))))


def _cut(parts: FloatArray) -> FloatArray:
    """Turn what each frame adds to estimates (K, T) into soft chips (T, K)."""
    rms = np.sqrt((parts**2).mean()) or 1.0
    return np.clip(parts.T / (CUT * rms), -1.0, 1.0)


def _variance(frame: Heights) -> float:
    """Measure the variance of the height of one vertex, by the median; inf if unknown."""
    seen = frame.count > 0.0
    if not seen.any():
        return np.inf
    x = frame.value[seen] / np.sqrt(frame.scatter[seen])
    return float((MAD_TO_SIGMA * np.median(np.abs(x - np.median(x)))) ** 2)


def _solve(basis: Basis, p: FloatArray, right: FloatArray) -> FloatArray:
    """Solve (B' p B + 1) w = B' right for columns (N, T), by conjugate gradients."""

    def apply(w: FloatArray) -> FloatArray:
        return basis.adjoint(p[:, None] * basis.heights(w)) + w

    preconditioner = 1.0 / (basis.squares(p) + 1.0)[:, None]
    return _conjugate_gradients(apply, basis.adjoint(right), preconditioner)


def _conjugate_gradients(
    A: Callable[[FloatArray], FloatArray], b: FloatArray, M: FloatArray
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
    for _ in range(ITERATIONS):
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
