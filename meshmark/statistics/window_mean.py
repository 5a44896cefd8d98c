"""The mean over everything that is searched, where carriers' shapes tell roughly their words."""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp

from meshmark.arrays import FloatArray, IntArray, SignArray
from meshmark.statistics.e_values import LIKELIEST, LOST, TILTS, e_values, likeliest
from meshmark.statistics.word_windows import SHIFT_BELIEF, Windows

# Readings are first compared at every other tilt.
EVERY = 2
# Chips up to which e-values fit into single precision, and what promises are wrong by there.
SINGLE_CHIPS, SINGLE_ERROR = 96, 0.02


def mean_over_windows(
    S: FloatArray,
    words: SignArray,
    log_null: FloatArray,
    log_prior: FloatArray,
    windows: Windows,
) -> FloatArray:
    """Average e-values over readings, tilts, shifts of all places, and assignments.

    Parameters
    ----------
    S : (R, C, K) float64
        Evidence under each of R readings.
    words : (n, M, K) int
        Words of n keys.
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
    rows = np.arange(len(words))[:, None]
    listed = _worth_a_look(S, words, log_null, log_prior, windows)
    score = windows.scores_under(S, words, listed)
    promised = _promises_under(score, log_null, log_prior, windows, listed)
    best = likeliest(promised)[0]
    reading, score = listed[rows, best], score[rows, best]
    e = e_values(score[:, :, None], log_null[reading], TILTS)
    log_belief = log_prior[reading][:, None, :, None] - np.log(len(TILTS))
    log_belief = log_belief + np.log(SHIFT_BELIEF)[:, None, None]
    promise = windows.promise(e, reading) + log_belief
    shift, place, tilt = likeliest(promise)
    picked = e[rows, place, tilt].reshape(-1, *score.shape[2:])
    log_means = windows.log_mean(picked, shift.ravel(), reading[rows, place].ravel())
    found = log_means.reshape(shift.shape) + log_belief[rows, shift, place, 0]
    return logsumexp(found, axis=-1)


def promises(
    S: FloatArray,
    words: SignArray,
    log_null: FloatArray,
    log_prior: FloatArray,
    windows: Windows,
) -> FloatArray:
    """Estimate what each reading adds to the mean of e-values, (n, R), in logarithms.

    Parameters are those of `mean_over_windows`. Words may be held twice here, which is quicker, and
    enough to tell readings apart.
    """
    score = windows.scores(S, words)
    belief = windows.blurred.transpose(1, 0, 2)
    weight = ((1.0 - LOST) * belief).astype(S.dtype)
    nothing = (LOST * belief.sum(axis=-1) + windows.p_null.T)[..., None].astype(S.dtype)
    best = np.full((len(S), len(words)), -np.inf, S.dtype)
    for t in range(0, len(TILTS), EVERY):
        e = score * S.dtype.type(TILTS[t])
        e -= log_null[:, t].T[..., None, None].astype(S.dtype)
        np.exp(e, out=e)
        each = np.einsum("crwn,crw->crn", e, weight) + nothing
        best = np.maximum(best, np.log(each).sum(axis=0))
    return best.T + log_prior


def _worth_a_look(
    S: FloatArray,
    words: SignArray,
    log_null: FloatArray,
    log_prior: FloatArray,
    windows: Windows,
) -> IntArray:
    """List the readings among which the most promising of each key are, (n, P), in order.

    Told from single precision, in which most of the time would be spent otherwise.
    """
    R, _, K = S.shape
    if R <= LIKELIEST or K > SINGLE_CHIPS:
        return np.broadcast_to(np.arange(R), (len(words), R))
    promised = promises(S.astype(np.float32), words, log_null, log_prior, windows)
    least = np.partition(promised, -LIKELIEST, axis=-1)[:, -LIKELIEST, None]
    size = int((promised >= least - SINGLE_ERROR).sum(axis=-1).max())
    chosen = np.argpartition(-promised, size - 1, axis=-1)[:, :size]
    return np.sort(chosen, axis=-1)


def _promises_under(
    score: FloatArray,
    log_null: FloatArray,
    log_prior: FloatArray,
    windows: Windows,
    reading: IntArray,
) -> FloatArray:
    """Estimate as `promises` does, from scores (n, P, C, W) under some readings (n, P)."""
    e = e_values(score[:, :, None], log_null[reading][:, :, ::EVERY], TILTS[::EVERY])
    each = np.einsum("nptcw,npcw->nptc", e, windows.blurred[reading], optimize=True)
    each += windows.p_null[reading][:, :, None]
    return np.log(each).sum(axis=-1).max(axis=-1) + log_prior[reading]
