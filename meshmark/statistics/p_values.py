"""P-values: bounds on the probability that a random key scores as well on fixed evidence.

The null hypothesis is the same throughout. Evidence S, one signed number a chip, is measured
without the key; a key chosen at random gives independent uniform signs w. Whatever the mesh, then,

    E(l) = prod_k exp(l w_k S_k) / cosh(l S_k)

has expectation exactly 1 for every l >= 0, because (e^x + e^-x) / 2 = cosh x. A non-negative
number of expectation at most 1 is an e-value, and P(E >= 1/p) <= p by Markov's inequality
[1]_. A weighted mean of e-values is an e-value: averaging over all hypotheses that are tested
corrects for multiple testing.

Where one word is on all carriers, sums of thousands of weak chips are bounded more tightly [2]_:
P(sum_k w_k S_k >= z |S|) <= c P(N >= z) for every z, with a standard normal N and c = 3.178.

References
----------
.. [1] V. Vovk, R. Wang, "E-values: Calibration, combination and applications", The Annals of
   Statistics 49(3), 2021. https://doi.org/10.1214/20-AOS2020
.. [2] V. K. Bentkus, D. Dzindzalieta, "A tight Gaussian bound for weighted sums of Rademacher
   random variables", Bernoulli 21(2), 2015. https://doi.org/10.3150/14-BEJ603
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.special import log_ndtr, logsumexp

from meshmark.arrays import BoolArray, FloatArray, SignArray
from meshmark.statistics.assignments import mean_over_assignments
from meshmark.statistics.e_values import P_DESTROYED, TILTS, e_values, log_cosh, top_terms
from meshmark.statistics.window_mean import (
    approximate_log_means,
    bound_over_windows,
    mean_over_windows,
)
from meshmark.statistics.word_windows import SHIFT_PRIOR, WINDOW_SIZE, WordPosterior

# Scores (keys or recipients, hypotheses, carriers, words) held at once: bounds memory.
SCORES_AT_ONCE = 2_000_000

# c of the normal bound, and the share of the rate that it has; the rest is the e-value's, which is
# lower where nearly all chips agree.
LOG_NORMAL_FACTOR = -float(np.log(4.0) + log_ndtr(-np.sqrt(2.0)))
NORMAL_SHARE = 0.9

# Up to here the exact tail is a table of 2^K sums; beyond, the e-value takes over.
MAX_EXACT_CHIPS = 18


def word_log_e(S: FloatArray, words: SignArray) -> FloatArray:
    """Log e-value of every word on every carrier, for every tilt.

    Parameters
    ----------
    S : (C, K) float64
        Evidence of C carriers.
    words : (..., M, K) int
        Signs; leading axes are keys or recipients.

    Returns
    -------
    (..., len(TILTS), C, M) float64
    """
    score = np.einsum("ck,...mk->...cm", S, words.astype(np.float64))
    null = log_cosh(TILTS[:, None, None] * S).sum(axis=-1)
    return TILTS[:, None, None] * score[..., None, :, :] - null[:, :, None]


def word_log_e_means(
    S: FloatArray, log_prior: FloatArray, words: SignArray, posterior: WordPosterior | None = None
) -> FloatArray:
    """Log e-value of words on evidence under several hypotheses, corrected for testing them all.

    Parameters
    ----------
    S : (R, C, K) float64
        Evidence under each of R hypotheses.
    log_prior : (R,) float64
        Log prior of each hypothesis; the exponentials sum to at most 1.
    words : (..., M, K) int
        A key's words; leading axes are keys or recipients.
    posterior : WordPosterior, optional
        Which words carriers may hold; any by default, rather those in order.

    Returns
    -------
    (...) float64

    Notes
    -----
    Averaged over hypotheses, tilts and assignments. A carrier that an attack destroyed may hold
    nothing: it then costs `P_DESTROYED`, not all of its noise. Assignments are summed up only for
    the `N_TOP_TERMS` pairs of hypothesis and tilt: no term is negative, so that leaving some out
    can only make the e-value smaller.
    """
    if posterior is None:
        return _in_portions(partial(_mean_over_hypotheses, S), S, log_prior, words, words.shape[-2])
    windows = posterior.windows(words.shape[-2])
    mean = partial(mean_over_windows, S, windows=windows)
    return _in_portions(mean, S, log_prior, words, WINDOW_SIZE)


def word_log_e_bounds(
    S: FloatArray, log_prior: FloatArray, words: SignArray, posterior: WordPosterior
) -> FloatArray:
    """Bound `word_log_e_means` from above, in a third of the time; parameters are the same."""
    bound = partial(bound_over_windows, S, windows=posterior.windows(words.shape[-2]))
    return _in_portions(bound, S, log_prior, words, WINDOW_SIZE)


def _in_portions(
    compute: Callable[..., FloatArray],
    S: FloatArray,
    log_prior: FloatArray,
    words: SignArray,
    width: int,
) -> FloatArray:
    """Compute something of words (..., M, K), as many at once as memory is meant for."""
    lead, flat = words.shape[:-2], words.reshape(-1, *words.shape[-2:])
    log_null = log_null_of(S)
    at_once = max(1, SCORES_AT_ONCE // (S.shape[0] * S.shape[1] * width))
    portions = [
        compute(words=flat[start : start + at_once], log_null=log_null, log_prior=log_prior)
        for start in range(0, len(flat), at_once)
    ]
    return np.concatenate(portions).reshape(lead)


def approximate_log_mean_by_hypothesis(
    S: FloatArray, log_prior: FloatArray, words: SignArray, posterior: WordPosterior
) -> FloatArray:
    """Approximate the log of what each hypothesis adds to the e-value of one key's words, (R,).

    Parameters are those of `word_log_e_means`, for words (M, K).
    """
    windows = posterior.windows(len(words))
    return approximate_log_means(S, words[None], log_null_of(S), log_prior, windows)[0]


def log_null_of(S: FloatArray) -> FloatArray:
    """Sum log cosh of tilt times evidence (R, C, K), (R, T, C)."""
    return log_cosh(TILTS[:, None, None, None] * S).sum(axis=-1).transpose(1, 0, 2)


def _mean_over_hypotheses(
    S: FloatArray, words: SignArray, log_null: FloatArray, log_prior: FloatArray
) -> FloatArray:
    score = np.einsum("rck,nmk->nrcm", S, words.astype(np.float64), optimize=True)
    e = e_values(score[:, :, None], log_null, TILTS)
    log_weight = np.broadcast_to(log_prior[:, None] - np.log(len(TILTS)), (len(S), len(TILTS)))
    hypothesis, tilt = top_terms(np.log(e.max(axis=-1)).sum(axis=-1) + log_weight)
    log_means = mean_over_assignments(np.log(e[np.arange(len(e))[:, None], hypothesis, tilt]))
    return logsumexp(log_means + log_weight[hypothesis, tilt], axis=-1)


def log10_p_words(
    S: FloatArray,
    words: SignArray,
    log_prior: FloatArray | None = None,
    posterior: WordPosterior | None = None,
) -> FloatArray:
    """Bound log10 of the probability that random words do as well, corrected for all tests.

    Parameters
    ----------
    S : (R, C, K) or (C, K) float64
        Evidence, under each hypothesis where there are several.
    words : (..., M, K) int
        The key's words; M = 1 means that all carriers share one word.
    log_prior : (R,) float64, optional
        Log prior of each hypothesis; uniform by default.
    posterior : WordPosterior, optional
        Which words carriers may hold.

    Returns
    -------
    (...) float64
        At most 0.
    """
    S = S[None] if S.ndim == 2 else S
    prior = np.full(len(S), -np.log(len(S))) if log_prior is None else log_prior
    if words.shape[-2] > 1:
        return _markov(word_log_e_means(S, prior, words, posterior))
    if len(S) == 1:
        return _log10_p_shared(S[0].sum(axis=0), words[..., 0, :])
    # One word for all carriers: each hypothesis's sum over them stands for a carrier.
    S = S.sum(axis=1)
    log_e = _log_mean(word_log_e(S, words)[..., 0], axis=-2)
    by_e_value = -logsumexp(log_e + prior, axis=-1) - np.log1p(-NORMAL_SHARE)
    by_normal = (normal_log_p(S, words[..., 0, :]) - prior).min(axis=-1) - np.log(NORMAL_SHARE)
    return np.minimum(0.0, np.minimum(by_e_value, by_normal) / np.log(10.0))


def normal_log_p(S: FloatArray, word: SignArray) -> FloatArray:
    """Bound log P(w'.S >= w.S) for uniform signs w' by the normal distribution.

    Parameters
    ----------
    S : (R, K) float64
        Evidence under each of R hypotheses.
    word : (..., K) int
        Signs.

    Returns
    -------
    (..., R) float64
        Above 0 where even 1 is too low a bound.
    """
    norm = np.linalg.norm(S, axis=1)
    score = word.astype(np.float64) @ S.T
    z = np.divide(score, norm, out=np.full_like(score, -np.inf), where=norm > 0.0)
    return LOG_NORMAL_FACTOR + log_ndtr(-z)


def _log_mean(log_e: FloatArray, axis: int) -> FloatArray:
    return logsumexp(log_e, axis=axis) - np.log(log_e.shape[axis])


def _log10_p_shared(S: FloatArray, word: SignArray) -> FloatArray:
    chips = np.flatnonzero(S)
    if chips.size == 0:
        return np.zeros(word.shape[:-1])
    S, word = S[chips], word[..., chips]
    if chips.size <= MAX_EXACT_CHIPS:
        return exact_log10_p(S, word)
    return _markov(_log_mean(word_log_e(S[None], word[..., None, :])[..., 0, 0], axis=-1))


def _markov(log_e: FloatArray) -> FloatArray:
    """Turn log e-values into log10 p-values, p = min(1, 1 / E)."""
    return np.minimum(0.0, -log_e / np.log(10.0))


def exact_log10_p(S: FloatArray, word: SignArray) -> FloatArray:
    """Exact log10 P(w'.S >= w.S) for uniform signs w', from all 2^K sums.

    Parameters
    ----------
    S : (K,) float64
        Evidence, K at most `MAX_EXACT_CHIPS`.
    word : (..., K) int
        Signs.
    """
    sums = np.zeros(1)
    for s in S:
        sums = np.concatenate([sums - s, sums + s])
    sums.sort()
    # Sums that agree on paper differ in the last bit by the order they were added in; counting
    # all within this width as reached errs towards a larger p.
    slack = 1e-9 * np.abs(S).sum()
    reached = len(sums) - np.searchsorted(sums, word @ S - slack, side="left")
    return np.log10(np.maximum(reached, 1) / len(sums))


def reachable_log10_p(
    usable: BoolArray,
    n_words: int,
    log_prior: float = 0.0,
    posterior: WordPosterior | None = None,
) -> float:
    """Lowest log10 p that chips which are not erasures could give the best of keys.

    Parameters
    ----------
    usable : (C, K) bool
        Which chips are no erasures.
    n_words : int
        Number of words; 1 if shared.
    log_prior : float
        Log prior of the hypothesis under which they are.
    posterior : WordPosterior, optional
        Which words carriers may hold under that hypothesis.
    """
    if n_words == 1:
        return -float(usable.any(axis=0).sum() * np.log10(2.0))
    if posterior is not None:
        # The best of keys gives carriers the words nearest to their positions, none twice.
        windows = posterior.windows(n_words)
        right = np.outer(TILTS - log_cosh(TILTS), usable.sum(axis=1))
        e = np.full((len(TILTS), len(usable), WINDOW_SIZE), P_DESTROYED)
        carriers, best = windows.most_probable_words(n_words)
        e[:, carriers, best] += (1.0 - P_DESTROYED) * np.exp(right[:, carriers])
        first = np.zeros(len(TILTS), dtype=np.int64)
        log_mean = _log_mean(windows.log_mean(e, first, first), axis=0)
        return float(_markov(log_mean + np.log(SHIFT_PRIOR[0]) + log_prior))
    # The best of keys gives the first carriers their words in order, and none fits another's.
    C = min(len(usable), n_words)
    right = np.outer(TILTS - log_cosh(TILTS), usable[:C].sum(axis=1))
    log_e = np.full((len(TILTS), len(usable), n_words), np.log(P_DESTROYED))
    log_e[:, np.arange(C), np.arange(C)] = np.logaddexp(
        np.log(P_DESTROYED), np.log1p(-P_DESTROYED) + right
    )
    return float(_markov(_log_mean(mean_over_assignments(log_e), axis=0) + log_prior))
