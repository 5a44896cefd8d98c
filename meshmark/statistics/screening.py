"""A quick bound on what words can be worth: whoever could not be found is never judged exactly.

The mean over assignments of products of e-values is at most the product of the carriers' largest
ones, or of 1 where that is larger. Of the e-value of a word on a carrier only its score m depends
on the word: log e = l m - sum log cosh(l S), a straight line for every tilt l. The lines of
`STEEP` and larger tilts meet next to the largest score there can be, where one chord replaces them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray, SignArray
from meshmark.statistics.e_values import N_TOP_TERMS, TILTS, log_cosh
from meshmark.statistics.word_windows import SHIFT_PRIOR, WINDOW_SIZE, WordPosterior

# Tilts from this on share a line; each below has its own.
STEEP = 8.0
# Keys whose scores are computed at once: they then fit into a processor's cache.
AT_ONCE = 256
# So many are judged exactly whatever their bounds are: those with the highest ones.
FEW = 128
# By this single precision errs at most in a log e-value.
ROUNDING = 1e-3
# What the largest terms of a mean sum up to at most, beside the largest of them all.
LOG_WEIGHT = float(np.log(N_TOP_TERMS * SHIFT_PRIOR.max() / len(TILTS)))


@dataclass(frozen=True, eq=False)
class Screened:
    """Evidence under several hypotheses, and where words may be.

    Parameters
    ----------
    S : (R, C, K) float64
        Evidence under each of R hypotheses.
    log_prior : (R,) float64
        Log prior of each hypothesis.
    posterior : WordPosterior
        Which words carriers may hold.
    """

    S: FloatArray
    log_prior: FloatArray
    posterior: WordPosterior


def worth_judging(log_e_bounds: FloatArray, least: float) -> IntArray:
    """List keys that may reach a log e-value, and a few that come nearest to it, in order."""
    high = np.flatnonzero(log_e_bounds >= least)
    best = np.argsort(-log_e_bounds, kind="stable")[:FEW]
    return np.union1d(high, best)


class Screen:
    """Bounds log e-values of words from above, on what several ways to read a mesh say.

    Parameters
    ----------
    evidence : sequence of Screened
        One for each way to read it, at least one; the e-value is the sum of theirs.
    n_words : int
        M, the words of a key.
    least : float
        Log e-value that matters: keys and hypotheses that cannot reach it are left out early.

    Attributes
    ----------
    words : (U,) int
        Which of a key's words are asked for.
    least_of_each : float
        Log e-value that one way at least must reach, for all of them to reach `least`.
    """

    def __init__(self, evidence: Sequence[Screened], n_words: int, least: float) -> None:
        self.least = least
        # Of n that sum up to e^x, one is at least e^x / n.
        self.least_of_each = least - float(np.log(len(evidence)))
        firsts = [item.posterior.first_words(n_words) for item in evidence]
        begins = np.unique(np.concatenate([first.ravel() for first in firsts]))
        self.words: IntArray = np.unique(begins[:, None] + np.arange(WINDOW_SIZE))
        self._parts = [
            _Part.of(item, np.searchsorted(self.words, first), self.least_of_each)
            for item, first in zip(evidence, firsts, strict=True)
        ]

    def log_e_bounds(self, words: SignArray) -> FloatArray:
        """Bound the log e-value of each key's words from above, (n,).

        Parameters
        ----------
        words : (n, U, K) int
            Of each of n keys, those that `words` lists.

        Returns
        -------
        (n,) float64
            -inf for keys that cannot reach `least`.
        """
        each = self.bounds_by_part(words)
        # What was left out somewhere is worth less than that there.
        total = np.logaddexp.reduce(np.maximum(each, self.least_of_each), axis=0)
        return np.where((each > -np.inf).any(axis=0), total, -np.inf)

    def bounds_by_part(self, words: SignArray) -> FloatArray:
        """Bound it for each way to read the mesh, (P, n); -inf below `least_of_each`."""
        found = np.empty((len(self._parts), len(words)))
        for some in (slice(n, n + AT_ONCE) for n in range(0, len(words), AT_ONCE)):
            signs = np.ascontiguousarray(words[some].transpose(1, 2, 0), np.float32)
            found[:, some] = [part.bounds(signs) for part in self._parts]
        return found


@dataclass(frozen=True, eq=False)
class _Part:
    """One way to read a mesh, for R hypotheses of those that can reach what matters.

    Parameters
    ----------
    S : (R, C, K) float32
    windows : sequence of C lists of (int, array of int)
        Where windows begin, and hypotheses that have one there.
    slopes, zeros : (J, R, C) float32
        Lines: log e is at most slope (m - zero) above the zero.
    offsets : (J, R) float64
        Log priors, less all zeros times slopes.
    needed : (C, J, R) float32
        What the sum of slopes times scores must have reached after each carrier.
    """

    S: NDArray[np.float32]
    windows: Sequence[Sequence[tuple[int, IntArray]]]
    slopes: NDArray[np.float32]
    zeros: NDArray[np.float32]
    offsets: FloatArray
    needed: NDArray[np.float32]

    @classmethod
    def of(cls, item: Screened, first: IntArray, least: float) -> _Part:
        lines = list(_lines(item.S))
        size = np.abs(item.S).sum(axis=-1)
        best = [(slope * (size - zero)).sum(axis=-1) + item.log_prior for slope, zero in lines]
        matters = np.array(best) + LOG_WEIGHT + ROUNDING >= least
        r, j = np.flatnonzero(matters.any(axis=0)), np.flatnonzero(matters.any(axis=1))
        slopes, zeros = (np.array(each)[np.ix_(j, r)] for each in zip(*lines, strict=True))
        offsets = item.log_prior[r] - (slopes * zeros).sum(axis=-1)
        # The best of words would add so much after each carrier.
        most = np.moveaxis(slopes * np.maximum(size[r], zeros), -1, 0)
        to_come = most.sum(axis=0) - np.cumsum(most, axis=0)
        needed = least - LOG_WEIGHT - ROUNDING - offsets - to_come
        return cls(
            item.S[r].astype(np.float32),
            [
                [(int(begin), np.flatnonzero(begins == begin)) for begin in np.unique(begins)]
                for begins in first[r].T
            ],
            slopes.astype(np.float32),
            zeros.astype(np.float32),
            offsets,
            needed.astype(np.float32),
        )

    def bounds(self, signs: NDArray[np.float32]) -> FloatArray:
        """Bound the log e-value of words (U, K, n) from above, (n,).

        Carrier by carrier: keys that can no longer reach what matters are left out of the rest.
        """
        found = np.full(signs.shape[-1], -np.inf)
        left = np.arange(len(found) if self.slopes.size else 0)
        total = np.zeros((*self.slopes.shape[:2], len(left)), np.float32)
        for c, windows in enumerate(self.windows):
            if not len(left):
                return found
            score = self._best_scores(c, windows, signs)
            over = np.empty_like(score)
            for j in range(len(total)):
                np.maximum(score, self.zeros[j, :, c, None], out=over)
                over *= self.slopes[j, :, c, None]
                total[j] += over
            if self.needed[c].max() > 0.0:
                alive = (total >= self.needed[c, :, :, None]).any(axis=(0, 1))
                if not alive.all():
                    left, signs, total = left[alive], signs[..., alive], total[..., alive]
        if len(left):
            best = (total + self.offsets[..., None]).max(axis=(0, 1))
            found[left] = best + (LOG_WEIGHT + ROUNDING)
        return found

    def _best_scores(
        self, c: int, windows: Sequence[tuple[int, IntArray]], signs: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Return the score of the best word of a carrier's window, (R, n)."""
        score = np.empty((len(self.S), signs.shape[-1]), np.float32)
        for begin, hypotheses in windows:
            near = signs[begin : begin + WINDOW_SIZE]
            score[hypotheses] = (self.S[hypotheses, c] @ near).max(axis=0)
        return score


def _lines(S: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield slopes and zeros, (R, C), of lines above the log e-value of each tilt."""
    for tilt in TILTS[TILTS < STEEP]:
        yield np.full(S.shape[:2], tilt), log_cosh(tilt * S).sum(axis=-1) / tilt
    zero, size = log_cosh(STEEP * S).sum(axis=-1) / STEEP, np.abs(S).sum(axis=-1)
    # The right word is worth most at the largest tilt.
    most = TILTS[-1] * size - log_cosh(TILTS[-1] * S).sum(axis=-1)
    room = size - zero
    yield np.divide(most, room, out=np.zeros_like(most), where=room > 0.0), zero
