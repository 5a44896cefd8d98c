"""E-values of a secret among decoys: how much better it fits than others drawn alike.

A secret consists of parts w_1, w_2, ..., and under the null hypothesis it and M decoys are
independent draws of the same distribution. Let l_b(w) be any number >= 0 that tells how well a
part fits the evidence; it may depend on the secret's parts before b, but on no later one. Given
those, the part w_b and those of the decoys are exchangeable, and

    e_b = l_b(w_b) / mean(l_b(w_b), l_b(decoy 1), ..., l_b(decoy M))

has mean 1: a soft-rank e-value [1]_. So has a bet of a share of what was won so far,
1 - c + c e_b, and so has the product over parts. No distribution of l has to be known.

References
----------
.. [1] N. Ignatiadis, R. Wang, A. Ramdas, "E-values as unnormalized weights in multiple testing",
   Biometrika 111(2), 2024. https://arxiv.org/abs/2204.12447
"""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from meshmark.arrays import FloatArray

# Share that is bet on each part: one that fits badly then costs no more than a factor of five.
BET = 0.8


def log_e_among_decoys(log_fit: FloatArray) -> FloatArray:
    """Compute the log e-values of secrets among their decoys.

    Parameters
    ----------
    log_fit : (B, ..., 1 + M) float64
        Log l_b of the secret, then of M decoys, for each of B parts; axes in between are secrets.

    Returns
    -------
    (...) float64
        Below B log(1 + M).
    """
    log_mean = logsumexp(log_fit, axis=-1) - np.log(log_fit.shape[-1])
    log_e = log_fit[..., 0] - log_mean
    return np.logaddexp(np.log1p(-BET), np.log(BET) + log_e).sum(axis=0)
