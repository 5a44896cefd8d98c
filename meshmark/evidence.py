"""Evidence: what a file says, before any key is tried on it; and what a key makes of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.special import logsumexp

from meshmark.keys import Key
from meshmark.statistics import log10_p_words, reachable_log10_p, word_log_e_means

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# A part whose every other bit is an erasure shows a small bit error rate by luck alone.
DECIDED_SHARE = 0.5
# Evidence is kept in steps of 1 / 127, an eighth of the room: whoever is judged by it is judged
# by the rounded numbers, which are as independent of the key as the others.
STEPS = 127


@dataclass(frozen=True, eq=False)
class Strand:
    """Evidence of one mesh over its frames, under one hypothesis of what was done to it.

    Parameters
    ----------
    restored : int
        Iterations of smoothing that were undone first.
    log_belief : float
        Log belief in this hypothesis, beside those of the other strands.
    log_prior : (R,) float64
        Log belief in each reading; the exponentials sum to at most 1.
    steps : (T, R, C, K) int8
        Evidence in [-1, 1] in units of 1 / `STEPS`; 0 for an erasure.
    """

    restored: int
    log_belief: float
    log_prior: FloatArray
    steps: NDArray[np.int8]

    @classmethod
    def of(
        cls,
        soft: NDArray[np.floating[Any]],
        log_prior: FloatArray,
        restored: int = 0,
        log_belief: float = 0.0,
    ) -> Strand:
        """Make a strand of evidence (T, R, C, K) in [-1, 1]."""
        steps = np.rint(STEPS * soft)
        # What says little still says something: only an erasure is 0.
        steps = np.where((soft != 0.0) & (steps == 0.0), np.sign(soft), steps)
        return cls(restored, log_belief, log_prior, steps.astype(np.int8))

    def frame(self, index: int) -> FloatArray:
        """Evidence of one frame, (R, C, K), in [-1, 1]."""
        return self.steps[index] / STEPS

    @cached_property
    def pooled(self) -> FloatArray:
        """Evidence of all frames together, (R, C, K): the mean of the frames' evidence.

        A sum of signed numbers measured without the key is again one, so that the frames need
        not be independent of each other for the p-value to hold.
        """
        return np.add.reduce(self.steps, axis=0, dtype=np.int64) / (STEPS * len(self.steps))

    @property
    def belief(self) -> FloatArray:
        """Log belief in each reading of this strand, (R,)."""
        return self.log_prior + self.log_belief

    def select(self, frames: Sequence[int]) -> Strand:
        """Keep some frames."""
        return Strand(self.restored, self.log_belief, self.log_prior, self.steps[list(frames)])


@dataclass(frozen=True, eq=False)
class Evidence:
    """Chips of one mesh over its frames, measured without any key.

    Parameters
    ----------
    prim : str
        The mesh.
    scheme : str
        The scheme that measured it.
    n_words : int
        Code words of that scheme; 1 if all carriers share one.
    times : (T,) float64
        Time codes of the frames.
    strands : tuple of Strand
        The mesh as it stands first; beside it, the mesh as it may have been.
    tracked : bool
        Whether a carrier is the same in all frames because its vertices are. If not, carriers
        of different frames were matched by what they look like, which can go wrong.
    """

    prim: str
    scheme: str
    n_words: int
    times: FloatArray
    strands: tuple[Strand, ...]
    tracked: bool = True

    @property
    def held(self) -> BoolArray:
        """Chips of the mesh as it stands that are held in some frame, (C, K) bool."""
        plain = self.strands[0].steps[:, 0]
        return np.asarray((plain != 0).any(axis=0))

    @property
    def n_chips(self) -> int:
        """Chips of one carrier, K."""
        return int(self.strands[0].steps.shape[3])

    @property
    def carriers(self) -> int:
        """Number of carriers, C, of the mesh as it stands."""
        return int(self.strands[0].steps.shape[2])

    @property
    def chips(self) -> int:
        """Number of chips that are held in some frame, shared ones counted once."""
        held = self.held
        return int(held.any(axis=0).sum() if self.n_words == 1 else held.sum())

    @property
    def reachable_log10_p(self) -> float:
        """Lowest log10 p that the best of keys could reach on as many chips."""
        plain = self.strands[0]
        return reachable_log10_p(self.held, self.n_words, float(plain.belief.max()))

    def words(self, key: Key, recipient: str | None) -> IntArray:
        """Derive the code words that `key` would have used here, (M, K) int."""
        return key.words(self.scheme, self.n_words, self.n_chips, recipient)

    def select(self, frames: Sequence[int]) -> Evidence:
        """Keep some frames."""
        strands = tuple(strand.select(frames) for strand in self.strands)
        times = self.times[list(frames)]
        return Evidence(self.prim, self.scheme, self.n_words, times, strands, self.tracked)


@dataclass(frozen=True, eq=False)
class BitErrors:
    """Bit error rates by the published protocol: the smallest among the parts of each frame.

    Parameters
    ----------
    per_frame : (T,) float64
        NaN for a frame in which no part decides enough bits.
    best_part : (T,) int
        The part that has it, the first of equals; -1 where no part decides enough bits.
    """

    per_frame: FloatArray
    best_part: IntArray

    @property
    def average(self) -> float:
        """Mean over the frames, NaN if none decides."""
        known = self.per_frame[~np.isnan(self.per_frame)]
        return float(known.mean()) if known.size else float("nan")

    @property
    def maximum(self) -> float:
        """Largest over the frames, NaN if none decides."""
        known = self.per_frame[~np.isnan(self.per_frame)]
        return float(known.max()) if known.size else float("nan")


@dataclass(frozen=True, eq=False)
class Finding:
    """What one hypothesis (a key and a recipient) makes of the evidence.

    Parameters
    ----------
    recipient : str or None
        Whose words were tried; None for the owner's own.
    log10_p : float
        Bound for all frames together, readings and assignment of words paid for.
    log10_p_per_frame : (T,) float64
        The same for each frame alone.
    errors : BitErrors
        Bit error rates against the words as best assigned to the carriers.
    """

    recipient: str | None
    log10_p: float
    log10_p_per_frame: FloatArray
    errors: BitErrors


# Recipients whose words are tried on each frame by itself.
SHORT_LIST = 16


def judge(evidence: Evidence, key: Key, recipient: str | None = None) -> Finding:
    """Try one key and recipient on the evidence."""
    return judge_best(evidence, key, (recipient,))


def judge_best(evidence: Evidence, key: Key, recipients: Sequence[str | None]) -> Finding:
    """Try a key and several recipients on the evidence, and return what fits best.

    The search among them is not paid for here: its price is for the caller to add.
    """
    words = np.array([evidence.words(key, recipient) for recipient in recipients])
    log10_p = log10_p_of(evidence, words)
    best = int(np.argmin(log10_p))
    frames = range(len(evidence.times))
    return Finding(
        recipient=recipients[best],
        log10_p=float(log10_p[best]),
        log10_p_per_frame=np.array(
            [min(0.0, float(_pooled_log10_p(evidence.select([t]), words[best]))) for t in frames]
        ),
        errors=bit_errors(evidence, words[best]),
    )


def log10_p_of(evidence: Evidence, words: IntArray) -> FloatArray:
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
    Some frames may be spoilt (poses that a retiming made up), want different readings, or have
    had their carriers matched wrongly. Half of the belief is therefore in the frames each by
    itself: the mean of their e-values is an e-value too. It is computed for the `SHORT_LIST`
    of those whose words fit all frames together best; for the others it counts as 0.
    """
    together = _pooled_log10_p(evidence, words)
    if evidence.n_words == 1 or len(evidence.times) == 1:
        return np.minimum(0.0, together)
    shared = together + np.log10(2.0)
    listed = np.argsort(together, kind="stable")[:SHORT_LIST]
    alone = np.array(
        [_pooled_log10_p(evidence.select([t]), words[listed]) for t in range(len(evidence.times))]
    )
    mean = logsumexp(-alone * np.log(10.0), axis=0) - np.log(2.0 * len(alone))
    shared[listed] = -np.logaddexp(-shared[listed] * np.log(10.0), mean) / np.log(10.0)
    return np.minimum(0.0, shared)


def _pooled_log10_p(evidence: Evidence, words: IntArray) -> FloatArray:
    """Bound log10 p from the frames' mean evidence; above 0 where even 1 is too low a bound."""
    first = evidence.strands[0]
    if words.shape[-2] == 1:
        return log10_p_words(first.pooled, words, first.belief)
    # Strands may have found different carriers; their e-values are averaged all the same.
    log_e = [word_log_e_means(strand.pooled, strand.belief, words) for strand in evidence.strands]
    pooled: FloatArray = -logsumexp(np.array(log_e), axis=0) / np.log(10.0)
    return pooled


def bit_errors(evidence: Evidence, words: IntArray) -> BitErrors:
    """Compare the bits of every part with its word, frame by frame.

    Erasures are neither right nor wrong: they leave the numerator and the denominator. A part
    that decides less than half of its bits in a frame is left out of that frame.

    Of several readings, the one that fits the words best is taken. Which part holds which word
    is told by all frames together, where vertices keep their identity. Where they do not, each
    frame is taken by itself: a part of one frame need not be there in another.
    """
    if evidence.tracked or len(words) == 1:
        strand, reading = _best_reading(evidence, words)
        return _bit_errors(strand.pooled[reading], strand.steps[:, reading], words)
    alone = [
        bit_errors(_as_tracked(evidence.select([t])), words) for t in range(len(evidence.times))
    ]
    return BitErrors(
        per_frame=np.concatenate([errors.per_frame for errors in alone]),
        best_part=np.concatenate([errors.best_part for errors in alone]),
    )


def _as_tracked(evidence: Evidence) -> Evidence:
    return Evidence(
        evidence.prim, evidence.scheme, evidence.n_words, evidence.times, evidence.strands
    )


def _best_reading(evidence: Evidence, words: IntArray) -> tuple[Strand, int]:
    """Find the strand and reading that agree with the words most."""
    best: tuple[float, Strand, int] = (-np.inf, evidence.strands[0], 0)
    for strand in evidence.strands:
        score = np.einsum("rck,mk->rcm", strand.pooled, words).max(axis=-1).sum(axis=-1)
        reading = int(np.argmax(score))
        if score[reading] > best[0]:
            best = (float(score[reading]), strand, reading)
    return best[1], best[2]


def _bit_errors(S: FloatArray, bits: NDArray[np.int8], words: IntArray) -> BitErrors:
    """Compare bits (T, C, K) with the words as the evidence S (C, K) gives them to the parts."""
    C, K = S.shape
    if len(words) == 1:
        carriers, of = np.arange(C), np.zeros(C, dtype=np.int64)
    else:
        carriers, of = linear_sum_assignment(S @ words.T, maximize=True)
    bits = bits[:, carriers]
    wrong = (bits != 0) & (np.sign(bits) != words[of])
    decided = (bits != 0).sum(axis=2)
    counts = decided >= DECIDED_SHARE * K
    rate = np.where(counts, wrong.sum(axis=2) / np.maximum(decided, 1), np.inf)
    best = rate.min(axis=1, initial=np.inf)
    found = np.isfinite(best)
    return BitErrors(
        per_frame=np.where(found, best, np.nan),
        best_part=np.where(found, carriers[rate.argmin(axis=1)], -1),
    )
