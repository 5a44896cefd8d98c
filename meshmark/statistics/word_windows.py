"""Which carrier holds which of many words, where a carrier's shape tells roughly which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from meshmark.arrays import FloatArray, IntArray, SignArray

# Words about a carrier's place that it may hold; a power of two of them is summed over.
WINDOW = 8
# Share of the belief that is even over the window.
ANY = 0.1
# The rest falls by exp(-d / NEARNESS), d words from the place. What roughens or smooths a copy
# changes the shape of its carriers alike: SHIFTS are words by which all places may be off. Each
# shift has a nearness of its own (the second is for bodies whose shape wanders), and a belief.
SHIFTS: FloatArray = np.array([0.0, 0.0, -1.0, 1.0, -2.0, 2.0])
NEARNESS: FloatArray = np.array([0.5, 1.5, 0.5, 0.5, 0.7, 0.7])
SHIFT_BELIEF: FloatArray = np.array([0.45, 0.15, 0.12, 0.12, 0.08, 0.08])

# Stands for "out of the question" in sums that must stay finite.
_NEVER = 1e6
# Places of which the middle is taken at once.
AT_ONCE = 1 << 19


@dataclass(frozen=True, eq=False)
class WordPosterior:
    """Where carriers stand in the list of words, as far as their shape tells.

    Parameters
    ----------
    position : (R, C) float64
        Place of each carrier's word in the list, under each reading; between two words where
        either may be meant. NaN where unknown: such a carrier says nothing.
    p_null : (C,) float64
        Belief that a carrier holds no word at all, in (0, 1).
    """

    position: FloatArray
    p_null: FloatArray

    def under(self, reading: int) -> WordPosterior:
        """Keep one reading."""
        return WordPosterior(self.position[[reading]], self.p_null)

    def windows(self, n_words: int) -> Windows:
        """Spread the belief of every carrier over the words about its place.

        Parameters
        ----------
        n_words : int
            M, at least `WINDOW`.
        """
        known = np.isfinite(self.position)
        place = np.where(known, self.position, 0.0)
        first = np.floor(place).astype(np.int64) - (WINDOW // 2 - 1)
        first = np.clip(first, 0, n_words - WINDOW)
        off = first[..., None] + np.arange(WINDOW) - place[..., None]
        shifts, nearness = SHIFTS[:, None, None, None], NEARNESS[:, None, None, None]
        near = np.exp(-np.abs(off - shifts) / nearness)
        near = (1.0 - ANY) * near / near.sum(axis=-1, keepdims=True) + ANY / WINDOW
        p_null = np.where(known, self.p_null, 1.0)
        return Windows(first, (1.0 - p_null)[..., None] * near, p_null)


def together(posteriors: Sequence[WordPosterior]) -> WordPosterior:
    """Say of the same carriers in several frames, those that show them, what most frames say.

    The posteriors may be many, and are asked for one at a time, more than once.
    """
    p_null = np.array([posterior.p_null for posterior in posteriors])
    shown = np.array([np.isfinite(posterior.position).all(axis=0) for posterior in posteriors])
    counts = shown.sum(axis=0)
    known = np.flatnonzero(counts)
    R, C = posteriors[0].position.shape
    middle = np.full((R, C), np.nan)
    rows = max(1, AT_ONCE // max(1, len(posteriors) * len(known)))
    for begin in range(0, R, rows):
        some = slice(begin, begin + rows)
        place = np.array([posterior.position[some, known] for posterior in posteriors])
        middle[some, known] = np.nanmedian(place, axis=0)
    shared = np.where(shown, p_null, 0.0).sum(axis=0) / np.maximum(counts, 1)
    return WordPosterior(middle, np.where(counts > 0, shared, 1.0))


@dataclass(frozen=True, eq=False)
class Windows:
    """The words that carriers may hold, and the belief in each.

    Parameters
    ----------
    first : (R, C) int
        First word of each carrier's window.
    belief : (Q, R, C, W) float64
        Belief in each word of the window, for each of `SHIFTS`.
    p_null : (R, C) float64
        Belief in none. With the others it sums to 1.
    """

    first: IntArray
    belief: FloatArray
    p_null: FloatArray

    def log_ways(self, shift: IntArray, reading: IntArray) -> FloatArray:
        """Log of the sum of beliefs over all ways in which no word is held twice, (N,).

        Parameters are those of `log_mean`.
        """
        known = self._known_ways
        new = np.isnan(known[shift, reading])
        if new.any():
            q, r = np.unique(np.stack([shift[new], reading[new]]), axis=1)
            known[q, r] = np.log(_sums(self.first[r], self.belief[q, r], self.p_null[r]))
        return known[shift, reading]

    @cached_property
    def _known_ways(self) -> FloatArray:
        """What `log_ways` found before, (Q, R); NaN where it was not asked."""
        return np.full(self.belief.shape[:2], np.nan)

    @cached_property
    def alike(self) -> list[tuple[int, int, IntArray]]:
        """Readings that give a carrier the same window: carrier, first word, and readings."""
        return [
            (c, int(first), np.flatnonzero(of_carrier == first))
            for c, of_carrier in enumerate(self.first.T)
            for first in np.unique(of_carrier)
        ]

    def likeliest(self, n_words: int) -> tuple[IntArray, IntArray]:
        """Give carriers the words believed in most, none twice, where nothing is shifted.

        Parameters
        ----------
        n_words : int
            M.

        Returns
        -------
        carriers, within : (n,) int
            Carriers that get one, and which of their window, under the first reading.
        """
        belief, first = self.belief[0, 0], self.first[0]
        log_belief = np.full((len(first), n_words), -_NEVER)
        words = first[:, None] + np.arange(WINDOW)
        np.put_along_axis(log_belief, words, np.log(np.maximum(belief, 1e-300)), axis=1)
        carriers, chosen = linear_sum_assignment(log_belief, maximize=True)
        possible = log_belief[carriers, chosen] > -_NEVER
        carriers, chosen = carriers[possible], chosen[possible]
        return carriers, chosen - first[carriers]

    def scores(self, S: NDArray[Any], words: SignArray) -> NDArray[Any]:
        """Sum each word of a carrier's window times its evidence, (C, R, W, n), in S's type.

        Parameters
        ----------
        S : (R, C, K) floating
            Evidence.
        words : (n, M, K) int
            Words of n keys.
        """
        R, C, K = S.shape
        scores = np.empty((C, R, WINDOW, len(words)), S.dtype)
        signs = np.ascontiguousarray(words.transpose(2, 1, 0), S.dtype)
        for c, first, readings in self.alike:
            near = signs[:, first : first + WINDOW].reshape(K, -1)
            scores[c, readings] = (S[readings, c] @ near).reshape(-1, WINDOW, len(words))
        return scores

    def scores_under(self, S: FloatArray, words: SignArray, reading: IntArray) -> FloatArray:
        """Sum as `scores` does, under some readings (n, P) for each key, (n, P, C, W)."""
        index = self.first[reading][..., None] + np.arange(WINDOW)
        near = words[np.arange(len(words))[:, None, None, None], index].astype(np.float64)
        return np.einsum("npck,npcwk->npcw", S[reading], near, optimize=True)

    @cached_property
    def blurred(self) -> FloatArray:
        """Belief in each word of the window, whatever the shift, (R, C, W)."""
        return np.tensordot(SHIFT_BELIEF, self.belief, axes=1)

    def promise(self, e: FloatArray, reading: IntArray) -> FloatArray:
        """Guess `log_mean` for every shift, (n, Q, P, T): two carriers may hold one word.

        Parameters
        ----------
        e : (n, P, T, C, W) float64
            E-values under each of P readings.
        reading : (n, P) int
            Which readings those are.
        """
        each = np.einsum("nptcw,qnpcw->nqptc", e, self.belief[:, reading], optimize=True)
        return np.log(each + self.p_null[reading][:, None, :, None]).sum(axis=-1)

    def log_mean(self, e: FloatArray, shift: IntArray, reading: IntArray) -> FloatArray:
        """Average prod e[c, word of c] over the ways to give carriers words, no word twice.

        Parameters
        ----------
        e : (N, C, W) float64
            E-value of each word of a carrier's window.
        shift, reading : (N,) int
            The shift and the reading that each row is of.

        Returns
        -------
        (N,) float64
            Log of the mean. Distinct words are independent, so that the product for one way is
            an e-value; a carrier without a word contributes 1; and means of e-values are
            e-values.
        """
        scale = np.maximum(e.max(axis=-1), 1.0)
        x = self.belief[shift, reading] * (e / scale[..., None])
        summed = _sums(self.first[reading], x, self.p_null[reading] / scale)
        mean: FloatArray = np.log(summed) + np.log(scale).sum(axis=-1)
        return mean - self.log_ways(shift, reading)


def _sums(first: IntArray, x: FloatArray, idle: FloatArray) -> FloatArray:
    """Sum prod x[c, word of c] over all ways in which no word is held twice, (N,).

    Carriers are taken in the order of their windows, so that words before the present window
    can never be wanted again: which words of the window are used is all there is to remember.

    Parameters
    ----------
    first : (N, C) int
        First word of each carrier's window.
    x : (N, C, W) float64
        Factor of each word of the window.
    idle : (N, C) float64
        Factor of a carrier without a word.
    """
    order = np.argsort(first, axis=-1, kind="stable")
    first = np.take_along_axis(first, order, axis=-1)
    x = np.take_along_axis(x, order[..., None], axis=-2)
    idle = np.take_along_axis(idle, order, axis=-1)
    steps = np.minimum(np.diff(first, axis=-1, prepend=first[:, :1]), WINDOW)
    # Rows last: what is done to all of them at once then runs along memory.
    x, idle = np.ascontiguousarray(x.transpose(1, 2, 0)), np.ascontiguousarray(idle.T)
    table = np.zeros((1 << WINDOW, len(first)))
    table[0] = 1.0
    for c in range(len(x)):
        table = _advanced(table, steps[:, c])
        grown = table * idle[c]
        for w in range(WINDOW):
            # Sets of used words by the words above w, whether w is among them, those below.
            halves = (1 << (WINDOW - w - 1), 2, 1 << w, len(first))
            grown.reshape(halves)[:, 1] += table.reshape(halves)[:, 0] * x[c, w]
        table = grown
    return table.sum(axis=0)


def _advanced(table: FloatArray, steps: IntArray) -> FloatArray:
    """Forget the first words of the window, as many as each step (N,), in tables (2^W, N)."""
    result = table.copy()
    for step in np.unique(steps[steps > 0]).tolist():
        rows = np.flatnonzero(steps == step)
        kept = 1 << (WINDOW - step)
        result[:kept, rows] = table[:, rows].reshape(kept, 1 << step, len(rows)).sum(axis=1)
        result[kept:, rows] = 0.0
    return result
