"""How sure: bounds on the probability that a random key scores as well on fixed evidence.

The law is the same throughout. Evidence S, one signed number a chip, is measured without the
key; a key chosen at random gives independent uniform signs w. Whatever the mesh, then,

    E(l) = prod_k exp(l w_k S_k) / cosh(l S_k)

has expectation exactly 1 for every l >= 0, because (e^x + e^-x) / 2 = cosh x. A non-negative
number of expectation at most 1 is an e-value, and P(E >= 1/p) <= p by Markov's inequality
[1]_. A weighted mean of e-values is an e-value, so whatever is searched is paid for by
averaging over it.

References
----------
.. [1] V. Vovk, R. Wang, "E-values: Calibration, combination and applications", The Annals of
   Statistics 49(3), 2021. https://doi.org/10.1214/20-AOS2020
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, logsumexp

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Soft chips lie in [-1, 1]. In steps of two, no best l in between is missed by more than the
# square root of two, and averaging over all eight costs log10(8) = 0.9 decades at the very most.
TILTS: FloatArray = 2.0 ** np.arange(-2.0, 6.0)

# Up to here the exact tail is a table of 2^K sums; beyond, the e-value takes over.
EXACT_CHIPS = 18


def log_cosh(x: FloatArray) -> FloatArray:
    """Compute log cosh x without overflow."""
    a = np.abs(x)
    return a + np.log1p(np.exp(-2.0 * a)) - np.log(2.0)


def word_log_e(S: FloatArray, words: IntArray) -> FloatArray:
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
    result: FloatArray = TILTS[:, None, None] * score[..., None, :, :] - null[:, :, None]
    return result


def mean_over_assignments(log_e: FloatArray) -> FloatArray:
    """Log of the mean of prod e[c, word of c] over all injective assignments of words.

    With more carriers than words, every choice of which carriers hold a word counts, and one
    that holds none contributes 1. Distinct words are independent, so the product for one
    assignment is an e-value and the mean over assignments is one.

    Parameters
    ----------
    log_e : (..., C, M) float64
        Log e-value of word m on carrier c.

    Returns
    -------
    (...) float64

    Notes
    -----
    The sum is a permanent. A dynamic program over the subsets of used words takes
    C M 2^M steps, done here for all leading axes at once.
    """
    *lead, C, M = log_e.shape
    table = np.full((*lead, 1 << M), -np.inf)
    table[..., 0] = 0.0
    masks = np.arange(1 << M)
    for c in range(C):
        grown = table.copy() if C > M else np.full_like(table, -np.inf)
        for m in range(M):
            free = masks[(masks >> m) & 1 == 0]
            grown[..., free | (1 << m)] = np.logaddexp(
                grown[..., free | (1 << m)], table[..., free] + log_e[..., c, m, None]
            )
        table = grown
    used = min(C, M)
    full = masks[_popcount(masks) == used]
    total: FloatArray = logsumexp(table[..., full], axis=-1)
    return total - log_assignments(C, M)


def log_assignments(n_carriers: int, n_words: int) -> float:
    """Log of the number of ways to give words to carriers, each word at most once."""
    more, fewer = max(n_carriers, n_words), min(n_carriers, n_words)
    return float(gammaln(more + 1) - gammaln(more - fewer + 1))


def _popcount(masks: IntArray) -> IntArray:
    bits = np.unpackbits(masks.astype(">u4").view(np.uint8).reshape(-1, 4), axis=1)
    return bits.sum(axis=1).astype(np.int64)


def log10_p_words(S: FloatArray, words: IntArray) -> FloatArray:
    """Bound log10 of the probability that random words do as well, assignment paid for.

    Parameters
    ----------
    S : (C, K) float64
        Evidence.
    words : (..., M, K) int
        The key's words; M = 1 means that all carriers share one word.

    Returns
    -------
    (...) float64
        At most 0.
    """
    n_words = words.shape[-2]
    if n_words == 1:
        return _log10_p_shared(S.sum(axis=0), words[..., 0, :])
    log_e = word_log_e(S, words)
    alike = _log_mean(_assigned(log_e), axis=-1)
    apart = _assigned(_mixed(log_e))
    return _markov(np.logaddexp(alike, apart) - np.log(2.0))


def _assigned(log_e: FloatArray) -> FloatArray:
    """Half a bet on the order in which words were given out, half on all assignments alike.

    Carriers are listed largest first, and words were given to them in that order. Where an
    attack left the order alone, finding the words again costs a factor of two.
    """
    used = np.arange(min(log_e.shape[-2:]))
    in_order = log_e[..., used, used].sum(axis=-1)
    return np.logaddexp(in_order, mean_over_assignments(log_e)) - np.log(2.0)


def _mixed(log_e: FloatArray) -> FloatArray:
    """Let every carrier have a tilt of its own, or hold nothing at all, (..., C, M).

    Where an attack destroyed some carriers and spared others, one tilt for all would charge
    the lost ones' noise to the others; this way a lost carrier costs a factor of two.
    """
    return np.logaddexp(0.0, _log_mean(log_e, axis=-3)) - np.log(2.0)


def _log_mean(log_e: FloatArray, axis: int) -> FloatArray:
    mean: FloatArray = logsumexp(log_e, axis=axis) - np.log(log_e.shape[axis])
    return mean


def _log10_p_shared(S: FloatArray, word: IntArray) -> FloatArray:
    chips = np.flatnonzero(S)
    if chips.size == 0:
        return np.zeros(word.shape[:-1])
    S, word = S[chips], word[..., chips]
    if chips.size <= EXACT_CHIPS:
        return exact_log10_p(S, word)
    return _markov(_log_mean(word_log_e(S[None], word[..., None, :])[..., 0, 0], axis=-1))


def _markov(log_e: FloatArray) -> FloatArray:
    return np.minimum(0.0, -log_e / np.log(10.0))


def exact_log10_p(S: FloatArray, word: IntArray) -> FloatArray:
    """Exact log10 P(w'.S >= w.S) for uniform signs w', from all 2^K sums.

    Parameters
    ----------
    S : (K,) float64
        Evidence, K at most `EXACT_CHIPS`.
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


def hoeffding_log10_p(S: FloatArray, word: IntArray) -> FloatArray:
    """Hoeffding's bound exp(-t^2 / (2 sum S^2)), t = w.S, for comparison.

    References
    ----------
    W. Hoeffding, "Probability inequalities for sums of bounded random variables", Journal of
    the American Statistical Association 58, 1963. https://doi.org/10.1080/01621459.1963.10500830
    """
    energy = float((S**2).sum())
    score = np.maximum(0.0, (word * S).sum(axis=-1))
    if energy == 0.0:
        return np.zeros_like(score)
    return -(score**2) / (2.0 * energy) / np.log(10.0)


def reachable_log10_p(held: NDArray[np.bool_], n_words: int) -> float:
    """Lowest log10 p that chips which are not erasures could give the best of keys.

    Parameters
    ----------
    held : (C, K) bool
        Which chips say something.
    n_words : int
        Number of words; 1 if shared.
    """
    if n_words == 1:
        return -float(held.any(axis=0).sum() * np.log10(2.0))
    # The best of keys gives the first carriers their words in order.
    first = held[:n_words].sum(axis=1)
    right = TILTS - log_cosh(TILTS)
    alike = _log_mean(first.sum() * right, axis=0)
    apart = (np.logaddexp(0.0, _log_mean(np.outer(right, first), axis=0)) - np.log(2.0)).sum()
    return float(_markov(np.logaddexp(alike, apart) - 2.0 * np.log(2.0)))
