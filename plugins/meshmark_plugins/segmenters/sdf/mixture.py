"""A mixture of Gaussians over the area-weighted histogram of a number in [0, 1]."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray

BINS = 1024
MIN_SIGMA = 0.02
"""Narrower clusters are noise: thickness within 2 % of the range is one thickness."""

MAX_ROUNDS = 500
TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False)
class Mixture:
    """Gaussians in one dimension, by increasing mean.

    Parameters
    ----------
    weight, mu, sigma : (k,) float64
        Share, mean and standard deviation of each.
    """

    weight: FloatArray
    mu: FloatArray
    sigma: FloatArray

    @classmethod
    def fit(cls, x: FloatArray, weight: FloatArray, k: int, *, tied: bool) -> Mixture:
        """Fit k Gaussians to weighted values by expectation-maximisation.

        Parameters
        ----------
        x : (n,) float64
            Values in [0, 1].
        weight : (n,) float64
            Weight of each, such as the area it stands for.
        k : int
            Number of Gaussians.
        tied : bool
            Whether all share one standard deviation.

        Notes
        -----
        The start is even over the range of the middle 98 % of the weight, not a draw, and the
        data are a histogram, so that the result depends neither on a seed nor on the order or
        the number of faces. scikit-learn's mixtures take no weights.
        """
        cell = np.minimum((x * BINS).astype(np.int64), BINS - 1)
        h = np.bincount(cell, weights=weight, minlength=BINS) / weight.sum()
        centre = (np.arange(BINS) + 0.5) / BINS
        low, high = centre[np.searchsorted(np.cumsum(h), [0.01, 0.99])]
        spread = np.sqrt(h @ (centre - h @ centre) ** 2)
        fitted = cls(
            np.full(k, 1.0 / k),
            low + (high - low) * (np.arange(k) + 0.5) / k,
            np.full(k, max(spread, MIN_SIGMA)),
        )
        likelihood = -np.inf
        for _ in range(MAX_ROUNDS):
            log_joint = fitted._log_joint(centre)
            log_total = np.logaddexp.reduce(log_joint, axis=1)
            before, likelihood = likelihood, float(h @ log_total)
            if likelihood - before < TOLERANCE:
                break
            fitted = _maximise(h[:, None] * np.exp(log_joint - log_total[:, None]), centre, tied)
        order = np.argsort(fitted.mu, kind="stable")
        return cls(fitted.weight[order], fitted.mu[order], fitted.sigma[order])

    def log_posterior(self, x: FloatArray) -> FloatArray:
        """Compute the log-probability of each Gaussian given each value, (n, k).

        Values beyond the outermost means count as those means: what is thicker than the
        thickest cluster belongs to it, however narrow it is.
        """
        log_joint = self._log_joint(np.clip(x, self.mu[0], self.mu[-1]))
        return log_joint - np.logaddexp.reduce(log_joint, axis=1)[:, None]

    def _log_joint(self, x: FloatArray) -> FloatArray:
        z = (x[:, None] - self.mu) / self.sigma
        return np.log(self.weight) - np.log(self.sigma) - 0.5 * z**2


def _maximise(share: FloatArray, x: FloatArray, tied: bool) -> Mixture:
    """Best Gaussians for given shares (n, k) of the values x (n,)."""
    weight = np.maximum(share.sum(axis=0), np.finfo(float).tiny)
    mu = x @ share / weight
    variance = (share * (x[:, None] - mu) ** 2).sum(axis=0) / weight
    if tied:
        variance = np.full_like(variance, weight @ variance / weight.sum())
    return Mixture(weight, mu, np.sqrt(np.maximum(variance, MIN_SIGMA**2)))
