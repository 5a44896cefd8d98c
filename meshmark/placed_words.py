"""The mean over everything that is searched, where carriers' shapes tell roughly their words."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from meshmark.evalues import TILTS, e_values, most_promising
from meshmark.placement import SHIFT_BELIEF, Windows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Readings are first compared at every other tilt.
EVERY = 2


def mean_of_placed(
    score: FloatArray, log_null: FloatArray, log_prior: FloatArray, windows: Windows
) -> FloatArray:
    """Average e-values over readings, tilts, shifts of all places, and assignments.

    Parameters
    ----------
    score : (n, R, C, W) float64
        Sum of each word of a carrier's window times the carrier's evidence; for n keys.
    log_null : (R, T, C) float64
        Sum of log cosh of tilt times evidence, for each of `TILTS`.
    log_prior : (R,) float64
        Log belief in each reading.
    windows : Windows
        The words that carriers may hold.

    Returns
    -------
    (n,) float64
        Log of the mean. Only what promises the most is summed up: leaving out what adds nothing
        but positive terms makes an e-value smaller, never dishonest.
    """
    n, _, C, W = score.shape
    rows = np.arange(n)[:, None]
    reading = most_promising(promises(score, log_null, log_prior, windows))[0]
    e = e_values(score[rows, reading][:, :, None], log_null[reading], TILTS)
    log_belief = log_prior[reading][:, None, :, None] - np.log(len(TILTS))
    log_belief = log_belief + np.log(SHIFT_BELIEF)[:, None, None]
    promise = windows.promise(e, reading) + log_belief
    shift, place, tilt = most_promising(promise)
    picked = e[rows, place, tilt].reshape(-1, C, W)
    log_means = windows.log_mean(picked, shift.ravel(), reading[rows, place].ravel())
    found = log_means.reshape(shift.shape) + log_belief[rows, shift, place, 0]
    mean: FloatArray = logsumexp(found, axis=-1)
    return mean


def promises(
    score: FloatArray, log_null: FloatArray, log_prior: FloatArray, windows: Windows
) -> FloatArray:
    """Estimate what each reading adds to the mean of e-values, (n, R), in logarithms.

    Parameters are those of `mean_of_placed`. Words may be held twice here, which is quicker, and
    enough to tell readings apart.
    """
    e = e_values(score[:, :, None], log_null[:, ::EVERY], TILTS[::EVERY])
    each = np.einsum("nrtcw,rcw->nrtc", e, windows.blurred) + windows.doubt[:, None]
    promise: FloatArray = np.log(each).sum(axis=-1).max(axis=-1) + log_prior
    return promise
