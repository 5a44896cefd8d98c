"""What a key makes of evidence: how sure it is of it, and which bits it gets wrong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from meshmark.arrays import FloatArray, SignArray
from meshmark.detection.bit_error_rate import BitErrors, bit_errors
from meshmark.detection.evidence import Evidence
from meshmark.keys import Key
from meshmark.statistics.p_values import (
    log10_p_words,
    normal_log_p,
    word_log_e_bounds,
    word_log_e_means,
)
from meshmark.statistics.screening import FEW, Screen, Screened, worth_judging

# Belief that all frames are best judged together; the rest is in the frames each by itself.
TOGETHER = 0.75
# Recipients whose words are tried on each frame by itself.
SHORT_LIST = 16
# By this a bound errs at most that is computed in another way than what it bounds.
ROUNDING = 1e-9
# Recipients that are looked for in single vertices: those whose words fit best, of whom chips have
# not said enough; and the share of the rate that this has.
VERTEX_LIST, ENOUGH = 256, -20.0
VERTEX_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class HypothesisResult:
    """What one hypothesis (a key and a recipient) makes of the evidence.

    Parameters
    ----------
    recipient : str or None
        Whose words were tried; None for the owner's own.
    unlimited_log10_p : float
        Bound for all frames together, corrected for multiple testing over hypotheses and
        assignments of words; above 0 where even 1 is too low a bound.
    log10_p_per_frame : (T,) float64
        The same for each frame alone.
    errors : BitErrors
        Bit error rates against the words as best assigned to the carriers.
    """

    recipient: str | None
    unlimited_log10_p: float
    log10_p_per_frame: FloatArray
    errors: BitErrors

    @classmethod
    def of_nothing(cls, n_frames: int) -> HypothesisResult:
        """Find nothing in so many frames without a chip."""
        nothing = BitErrors(np.full(n_frames, np.nan), np.full(n_frames, -1))
        return cls(None, np.inf, np.zeros(n_frames), nothing)

    @property
    def log10_p(self) -> float:
        """The bound, at most 0."""
        return min(0.0, self.unlimited_log10_p)


def judge(evidence: Evidence, key: Key, recipient: str | None = None) -> HypothesisResult:
    """Try one key and recipient on the evidence."""
    return judge_each(evidence, key, (recipient,))[0]


def judge_each(
    evidence: Evidence,
    key: Key,
    recipients: Sequence[str | None],
    log10_limit: float = -np.inf,
) -> list[HypothesisResult]:
    """Try a key and several recipients on the evidence.

    It is not corrected for multiple testing over them: that is for the caller to do.

    Parameters
    ----------
    log10_limit : float
        Whatever fits at least as well as this is returned, too. Of many recipients, those that
        cannot are left out early; a few stay all the same.

    Returns
    -------
    list of HypothesisResult
        The recipient that fits best, then the others that fit as well as the limit asks.
    """
    words = key.words_of(evidence.scheme, evidence.n_words, evidence.n_chips, recipients)
    many = len(words) > FEW and log10_limit > -np.inf
    screen = screen_of(evidence) if many else None
    if screen is not None:
        bounds = screen.log_e_bounds(words[:, screen.words])
        kept = worth_judging(bounds, -log10_limit * np.log(10.0))
        recipients, words = [recipients[n] for n in kept], words[kept]
    log10_p, alone = _judged(evidence, words)
    log10_p = _with_vertices(evidence, key, recipients, words, log10_p)
    order = np.argsort(log10_p, kind="stable")
    fitting = [n for rank, n in enumerate(order.tolist()) if rank == 0 or log10_p[n] <= log10_limit]
    return [
        HypothesisResult(
            recipient=recipients[n],
            unlimited_log10_p=float(log10_p[n]),
            log10_p_per_frame=np.minimum(
                0.0, alone[n] if n in alone else _alone(evidence, words[[n]])[:, 0]
            ),
            errors=bit_errors(evidence, words[n].astype(np.int64)),
        )
        for n in fitting
    ]


def screen_of(evidence: Evidence, log10_limit: float = np.inf) -> Screen | None:
    """Make a quick bound on what words may say of all frames together.

    Parameters
    ----------
    log10_limit : float
        The largest log10 p that matters; any by default.

    Returns
    -------
    Screen or None
        None where all carriers share one word, or may hold any: exact numbers are as quick.
    """
    parts = screened(evidence)
    if not parts:
        return None
    return Screen(parts, evidence.n_words, -log10_limit * float(np.log(10.0)))


def screened(evidence: Evidence) -> list[Screened]:
    """List the ways to read a mesh of which quick bounds are known; none but if of all."""
    parts = [
        Screened(variant.pooled, variant.belief, variant.posterior)
        for variant in evidence.variants
        if variant.posterior is not None
    ]
    return [] if evidence.n_words == 1 or len(parts) < len(evidence.variants) else parts


def log10_p_of_names(evidence: Evidence, key: Key, recipients: Sequence[str | None]) -> FloatArray:
    """Bound log10 p of each of several recipients by itself, (n,); None is the owner."""
    words = key.words_of(evidence.scheme, evidence.n_words, evidence.n_chips, recipients)
    log10_p = _judged(evidence, words)[0]
    return np.minimum(0.0, _with_vertices(evidence, key, recipients, words, log10_p))


def log10_p_of(evidence: Evidence, words: SignArray) -> FloatArray:
    """Bound log10 of the probability that random words fit all frames as well.

    Parameters
    ----------
    words : (n, M, K) int
        Words of n keys or recipients.

    Returns
    -------
    (n,) float64

    Notes
    -----
    Some frames may be spoilt (poses that a retiming made up), want different hypotheses, or have
    had their carriers matched wrongly. Some of the belief is therefore in the frames each by
    itself: the mean of their e-values is an e-value too. It is computed for the `SHORT_LIST`
    of those whose words fit all frames together best; for the others it counts as 0.
    """
    return np.minimum(0.0, _judged(evidence, words)[0])


def _judged(evidence: Evidence, words: SignArray) -> tuple[FloatArray, dict[int, FloatArray]]:
    """Bound log10 p of words, (n,), and tell what frames say by themselves of those listed.

    Bounds are above 0 where even 1 is too low a bound.
    """
    together = _together(evidence, words)
    if evidence.n_words == 1 or len(evidence.times) == 1:
        return together, {}
    shared = together - np.log10(TOGETHER)
    listed = np.argsort(together, kind="stable")[:SHORT_LIST]
    alone = _alone(evidence, words[listed])
    mean = logsumexp(-alone * np.log(10.0), axis=0) + np.log((1.0 - TOGETHER) / len(alone))
    shared[listed] = -np.logaddexp(-shared[listed] * np.log(10.0), mean) / np.log(10.0)
    return shared, dict(zip(listed.tolist(), alone.T, strict=True))


def _together(evidence: Evidence, words: SignArray) -> FloatArray:
    """Bound log10 p from the frames' mean evidence, (n,), of all who matter.

    Most of many names tell nothing. What they would get is bounded first, in less time: whoever
    could neither be in the `SHORT_LIST` nor come below 0 keeps that.
    """
    placed = all(variant.posterior is not None for variant in evidence.variants)
    if evidence.n_words == 1 or not placed or len(words) <= SHORT_LIST:
        return _pooled_log10_p(evidence, words)
    log10_p = _pooled_log10_p(evidence, words, word_log_e_bounds) - ROUNDING
    order = np.argsort(log10_p, kind="stable")
    known, wanted = 0, max(SHORT_LIST, int(np.sum(log10_p < 0.0)))
    while known < wanted:
        some = order[known:wanted]
        log10_p[some] = _pooled_log10_p(evidence, words[some])
        known, rest = wanted, order[wanted:]
        listed = np.partition(log10_p[order[:known]], SHORT_LIST - 1)[SHORT_LIST - 1]
        wanted = min(2 * known, known + int(np.sum(log10_p[rest] < listed)))
    return log10_p


def _with_vertices(
    evidence: Evidence,
    key: Key,
    recipients: Sequence[str | None],
    words: SignArray,
    log10_p: FloatArray,
) -> FloatArray:
    """Lower the bounds of recipients by what single vertices tell of them.

    Each bound is the better of two, which share the rate. The e-value of vertices counts as 0 for
    whoever is not tried: times a number that is 0 or 1 it is an e-value still.
    """
    if evidence.vertices is None or evidence.vertices.on is None:
        return log10_p
    named = np.array([name is not None for name in recipients])
    shared = np.where(named, log10_p - np.log10(1.0 - VERTEX_SHARE), log10_p)
    first = evidence.variants[0]
    rank = (normal_log_p(first.pooled.sum(axis=1), words[:, 0]) - first.belief).min(axis=1)
    order = np.argsort(rank, kind="stable")
    listed = order[(named & (log10_p > ENOUGH))[order]][:VERTEX_LIST]
    names = [name for n in listed.tolist() if (name := recipients[n]) is not None]
    log_e = evidence.vertices.log_e(key, evidence.scheme, names)
    by_vertices = -log_e / np.log(10.0) - np.log10(VERTEX_SHARE)
    shared[listed] = np.minimum(shared[listed], by_vertices)
    return shared


def _alone(evidence: Evidence, words: SignArray) -> FloatArray:
    """Bound log10 p of words (n, M, K) from each frame by itself, (T, n)."""
    frames = range(len(evidence.times))
    return np.array([_pooled_log10_p(evidence.select([t]), words) for t in frames])


def _pooled_log10_p(
    evidence: Evidence,
    words: SignArray,
    log_e_of: Callable[..., FloatArray] = word_log_e_means,
) -> FloatArray:
    """Bound log10 p from the frames' mean evidence; above 0 where even 1 is too low a bound."""
    first = evidence.variants[0]
    if words.shape[-2] == 1:
        return log10_p_words(first.pooled, words, first.belief)
    # Variants may have found different carriers; their e-values are averaged all the same.
    log_e = [
        log_e_of(variant.pooled, variant.belief, words, variant.posterior)
        for variant in evidence.variants
    ]
    return -logsumexp(np.array(log_e), axis=0) / np.log(10.0)
