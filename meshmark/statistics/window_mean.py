"""The mean of e-values over hypotheses, tilts, shifts and assignments of words in windows.

Multiple testing over all of these is corrected by averaging: a mean of e-values is an e-value
(Vovk and Wang, 2021; see `meshmark.statistics.p_values`). Only the largest terms are computed
exactly; they are found by cheaper approximations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from meshmark.arrays import FloatArray, IntArray, SignArray
from meshmark.statistics.e_values import N_TOP_TERMS, P_DESTROYED, TILTS, e_values, top_terms
from meshmark.statistics.word_windows import SHIFT_PRIOR, WordWindows

# Hypotheses are first compared at every other tilt.
TILT_STRIDE = 2
_SQUARINGS = int(np.log2(TILTS[TILT_STRIDE] / TILTS[0]))
# Chips up to which e-values fit into single precision, and the error of approximate log means
# there.
MAX_FLOAT32_CHIPS, FLOAT32_ERROR = 96, 0.02


def mean_over_windows(
    S: FloatArray,
    words: SignArray,
    log_null: FloatArray,
    log_prior: FloatArray,
    windows: WordWindows,
) -> FloatArray:
    """Average e-values over hypotheses, tilts, shifts of all positions, and assignments.

    Parameters
    ----------
    S : (R, C, K) float64
        Evidence under each of R hypotheses.
    words : (n, M, K) int
        Words of n keys.
    log_null : (R, T, C) float64
        Sum of log cosh of tilt times evidence, for each of `TILTS`.
    log_prior : (R,) float64
        Log prior of each hypothesis.
    windows : WordWindows
        The words that carriers may hold.

    Returns
    -------
    (n,) float64
        Log of the mean, of which only the largest terms are summed up: no term is negative, so
        that leaving some out can only make the e-value smaller.
    """
    terms = largest_terms(S, words, log_null, log_prior, windows)
    e, shape = terms.e.reshape(-1, *terms.e.shape[2:]), terms.shift.shape
    log_means = windows.log_mean(e, terms.shift.ravel(), terms.hypothesis.ravel())
    return logsumexp(log_means.reshape(shape) + terms.log_weight, axis=-1)


def bound_over_windows(
    S: FloatArray,
    words: SignArray,
    log_null: FloatArray,
    log_prior: FloatArray,
    windows: WordWindows,
) -> FloatArray:
    """Bound `mean_over_windows` from above, (n,), in a third of the time.

    Assignments in which two carriers hold one word, which no mean counts, are counted here, too.
    """
    terms = largest_terms(S, words, log_null, log_prior, windows)
    total = windows.log_total_prior(terms.shift.ravel(), terms.hypothesis.ravel())
    return logsumexp(terms.approximate - total.reshape(terms.shift.shape), axis=-1)


@dataclass(frozen=True, eq=False)
class Terms:
    """The largest terms of such means for n keys, P for each, the largest first.

    Parameters
    ----------
    e : (n, P, C, W) float64
        E-value of each word of a carrier's window.
    shift, hypothesis : (n, P) int
    log_weight : (n, P) float64
        Log prior of the hypothesis, tilt and shift together.
    approximate : (n, P) float64
        Log of the term, times the total prior of all assignments, as if two carriers could hold
        one word.
    """

    e: FloatArray
    shift: IntArray
    hypothesis: IntArray
    log_weight: FloatArray
    approximate: FloatArray


def largest_terms(
    S: FloatArray,
    words: SignArray,
    log_null: FloatArray,
    log_prior: FloatArray,
    windows: WordWindows,
) -> Terms:
    """Find the largest terms of the mean, as far as approximations tell.

    Parameters are those of `mean_over_windows`.
    """
    rows = np.arange(len(words))[:, None]
    listed = _shortlist(S, words, log_null, log_prior, windows)
    score = windows.scores_under(S, words, listed)
    best = top_terms(_approximate_log_means_under(score, log_null, log_prior, windows, listed))[0]
    hypothesis, score = listed[rows, best], score[rows, best]
    e = e_values(score[:, :, None], log_null[hypothesis], TILTS)
    log_weight = log_prior[hypothesis][:, None, :, None] - np.log(len(TILTS))
    log_weight = log_weight + np.log(SHIFT_PRIOR)[:, None, None]
    approximate = windows.approximate_log_mean(e, hypothesis) + log_weight
    shift, rank, tilt = top_terms(approximate)
    return Terms(
        e[rows, rank, tilt],
        shift,
        hypothesis[rows, rank],
        log_weight[rows, shift, rank, 0],
        approximate[rows, shift, rank, tilt],
    )


def approximate_log_means(
    S: FloatArray,
    words: SignArray,
    log_null: FloatArray,
    log_prior: FloatArray,
    windows: WordWindows,
) -> FloatArray:
    """Approximate the log of what each hypothesis adds to the mean of e-values, (n, R).

    Parameters are those of `mean_over_windows`. Here two carriers may hold one word, which is
    quicker, and enough to compare hypotheses.
    """
    prior = windows.prior_over_shifts
    weight = (1.0 - P_DESTROYED) * prior
    idle = (P_DESTROYED * prior.sum(axis=-1) + windows.p_null).astype(S.dtype)
    tilts, null = TILTS[::TILT_STRIDE], log_null[:, ::TILT_STRIDE]
    # Each tilt is some power of two times the one before: its exponentials are squares of squares.
    # Those of the largest tilt, divided by their mean, fit into single precision.
    root = null[:, -1] * (tilts[0] / tilts[-1])
    share = np.exp(root[:, None] * (tilts[:, None] / tilts[0]) - null)[..., None] * weight[:, None]
    share = share.astype(S.dtype)
    total = np.zeros((len(tilts), len(S), len(words)), S.dtype)
    for c, e in enumerate(windows.scores(S, words)):
        e *= S.dtype.type(tilts[0])
        e -= root[:, c, None, None].astype(S.dtype)
        np.exp(e, out=e)
        for t in range(len(tilts)):
            for _ in range(_SQUARINGS if t else 0):
                np.multiply(e, e, out=e)
            each = np.einsum("rwn,rw->rn", e, share[:, t, c]) + idle[:, c, None]
            total[t] += np.log(each, out=each)
    return total.max(axis=0).T + log_prior


def _shortlist(
    S: FloatArray,
    words: SignArray,
    log_null: FloatArray,
    log_prior: FloatArray,
    windows: WordWindows,
) -> IntArray:
    """List hypotheses among which the best of each key are, (n, P), in order.

    Told in single precision: in double precision, most of the time would be spent here.
    """
    R, _, K = S.shape
    if R <= N_TOP_TERMS or K > MAX_FLOAT32_CHIPS:
        return np.broadcast_to(np.arange(R), (len(words), R))
    approximate = approximate_log_means(S.astype(np.float32), words, log_null, log_prior, windows)
    least = np.partition(approximate, -N_TOP_TERMS, axis=-1)[:, -N_TOP_TERMS, None]
    size = int((approximate >= least - FLOAT32_ERROR).sum(axis=-1).max())
    chosen = np.argpartition(-approximate, size - 1, axis=-1)[:, :size]
    return np.sort(chosen, axis=-1)


def _approximate_log_means_under(
    score: FloatArray,
    log_null: FloatArray,
    log_prior: FloatArray,
    windows: WordWindows,
    hypothesis: IntArray,
) -> FloatArray:
    """Approximate the same from scores (n, P, C, W) under some hypotheses (n, P)."""
    e = e_values(score[:, :, None], log_null[hypothesis][:, :, ::TILT_STRIDE], TILTS[::TILT_STRIDE])
    each = np.einsum("nptcw,npcw->nptc", e, windows.prior_over_shifts[hypothesis], optimize=True)
    each += windows.p_null[hypothesis][:, :, None]
    return np.log(each).sum(axis=-1).max(axis=-1) + log_prior[hypothesis]
