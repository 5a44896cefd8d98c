"""Evidence: what a file says, before any key is tried on it; and what a key makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from meshmark.keys import Key
from meshmark.statistics import log10_p_words, reachable_log10_p

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# A part whose every other bit is an erasure shows a small bit error rate by luck alone.
DECIDED_SHARE = 0.5


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
    value : (T, C, K) float64
        Chip statistics; 0 where erased.
    held : (T, C, K) bool
        False for erasures.
    strength : float
        Statistic at which a chip counts in full.
    tracked : bool
        Whether a carrier is the same in all frames because its vertices are. If not, carriers
        of different frames were matched by their shape, which can go wrong.
    """

    prim: str
    scheme: str
    n_words: int
    times: FloatArray
    value: FloatArray
    held: BoolArray
    strength: float
    tracked: bool = True

    @property
    def per_frame(self) -> FloatArray:
        """Evidence of every single frame, (T, C, K), in [-1, 1]."""
        return np.clip(self.value / self.strength, -1.0, 1.0)

    @cached_property
    def pooled(self) -> FloatArray:
        """Evidence of all frames together, (C, K): the mean of the frames' evidence.

        A sum of signed numbers measured without the key is again one, so that the frames need
        not be independent of each other for the p-value to hold.
        """
        mean: FloatArray = self.per_frame.mean(axis=0)
        return mean

    @property
    def chips(self) -> int:
        """Number of chips that are held in some frame, shared ones counted once."""
        held = self.held.any(axis=0)
        return int(held.any(axis=0).sum() if self.n_words == 1 else held.sum())

    @property
    def reachable_log10_p(self) -> float:
        """Lowest log10 p that the best of keys could reach on as many chips."""
        held = np.asarray(self.held.any(axis=0))
        return reachable_log10_p(held, self.n_words)

    def words(self, key: Key, recipient: str | None) -> IntArray:
        """Derive the code words that `key` would have used here, (M, K) int."""
        return key.words(self.scheme, self.n_words, self.value.shape[2], recipient)


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
        Bound for all frames together, assignment of words paid for.
    log10_p_per_frame : (T,) float64
        The same for each frame alone.
    errors : BitErrors
        Bit error rates against the words as best assigned to the carriers.
    """

    recipient: str | None
    log10_p: float
    log10_p_per_frame: FloatArray
    errors: BitErrors


def judge(evidence: Evidence, key: Key, recipient: str | None = None) -> Finding:
    """Try one key and recipient on the evidence."""
    words = evidence.words(key, recipient)
    frames = evidence.per_frame
    return Finding(
        recipient=recipient,
        log10_p=float(log10_p_words(evidence.pooled, words)),
        log10_p_per_frame=np.array([float(log10_p_words(S, words)) for S in frames]),
        errors=bit_errors(evidence, words),
    )


def bit_errors(evidence: Evidence, words: IntArray) -> BitErrors:
    """Compare the bits of every part with its word, frame by frame.

    Erasures are neither right nor wrong: they leave the numerator and the denominator. A part
    that decides less than half of its bits in a frame is left out of that frame.

    Which part holds which word is told by all frames together, where vertices keep their
    identity. Where they do not, each frame is taken by itself: a part of one frame need not
    be there in another.
    """
    if evidence.tracked or len(words) == 1:
        return _bit_errors(evidence.pooled, evidence.value, evidence.held, words)
    frames = zip(evidence.per_frame, evidence.value, evidence.held, strict=True)
    alone = [_bit_errors(S, value[None], held[None], words) for S, value, held in frames]
    return BitErrors(
        per_frame=np.concatenate([errors.per_frame for errors in alone]),
        best_part=np.concatenate([errors.best_part for errors in alone]),
    )


def _bit_errors(S: FloatArray, value: FloatArray, held: BoolArray, words: IntArray) -> BitErrors:
    """Compare bits with the words as the evidence S (C, K) gives them to the parts."""
    C, K = S.shape
    if len(words) == 1:
        carriers, of = np.arange(C), np.zeros(C, dtype=np.int64)
    else:
        carriers, of = linear_sum_assignment(S @ words.T, maximize=True)
    held = held[:, carriers]
    wrong = held & (np.sign(value[:, carriers]) != words[of])
    decided = held.sum(axis=2)
    counts = decided >= DECIDED_SHARE * K
    rate = np.where(counts, wrong.sum(axis=2) / np.maximum(decided, 1), np.inf)
    best = rate.min(axis=1, initial=np.inf)
    found = np.isfinite(best)
    return BitErrors(
        per_frame=np.where(found, best, np.nan),
        best_part=np.where(found, carriers[rate.argmin(axis=1)], -1),
    )
