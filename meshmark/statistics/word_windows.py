"""Which carrier holds which of many words, where each carrier's shape tells roughly which."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from meshmark.arrays import FloatArray, IntArray, SignArray
from meshmark.statistics.assignments import with_carrier

# Words about a carrier's position that it may hold: sums are over the subsets of so many.
WINDOW_SIZE = 8
# Share of the prior that is uniform over the window.
UNIFORM_SHARE = 0.1
# The rest falls by exp(-d / SHIFT_DECAY), d words from the position. What roughens or smooths a
# copy changes the shape of its carriers alike: SHIFTS are words by which all positions may be off.
# Each shift has a decay of its own (the second is for bodies whose shape wanders), and a prior.
SHIFTS: FloatArray = np.array([0.0, 0.0, -1.0, 1.0, -2.0, 2.0])
SHIFT_DECAY: FloatArray = np.array([0.5, 1.5, 0.5, 0.5, 0.7, 0.7])
SHIFT_PRIOR: FloatArray = np.array([0.45, 0.15, 0.12, 0.12, 0.08, 0.08])

# Stands for "out of the question" in sums that must stay finite.
_IMPOSSIBLE = 1e6
# Positions of which the median is taken at once: bounds memory.
POSITIONS_AT_ONCE = 1 << 19
# Rows whose assignments are summed up at once: their tables then fit into a processor's cache.
ROWS_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class WordPosterior:
    """Positions of carriers in the list of words, as their shapes tell.

    Parameters
    ----------
    position : (R, C) float64
        Position of each carrier's word in the list, under each hypothesis; between two words
        where either may be meant. NaN where unknown: such a carrier says nothing.
    p_null : (C,) float64
        Probability that a carrier holds no word at all, in (0, 1).
    """

    position: FloatArray
    p_null: FloatArray

    def under(self, hypothesis: int) -> WordPosterior:
        """Keep one hypothesis."""
        return WordPosterior(self.position[[hypothesis]], self.p_null)

    def first_words(self, n_words: int) -> IntArray:
        """Return the first word of every carrier's window, (R, C); see `windows`."""
        position = np.where(np.isfinite(self.position), self.position, 0.0)
        first = np.floor(position).astype(np.int64) - (WINDOW_SIZE // 2 - 1)
        return np.clip(first, 0, n_words - WINDOW_SIZE)

    def windows(self, n_words: int) -> WordWindows:
        """Spread the probability of every carrier over the words about its position.

        Parameters
        ----------
        n_words : int
            M, at least `WINDOW_SIZE`.
        """
        known = np.isfinite(self.position)
        position = np.where(known, self.position, 0.0)
        first = self.first_words(n_words)
        off = first[..., None] + np.arange(WINDOW_SIZE) - position[..., None]
        shifts, decay = SHIFTS[:, None, None, None], SHIFT_DECAY[:, None, None, None]
        near = np.exp(-np.abs(off - shifts) / decay)
        near = (1.0 - UNIFORM_SHARE) * near / near.sum(axis=-1, keepdims=True)
        near = near + UNIFORM_SHARE / WINDOW_SIZE
        p_null = np.where(known, self.p_null, 1.0)
        return WordWindows(first, (1.0 - p_null)[..., None] * near, p_null)


def median_posterior(posteriors: Sequence[WordPosterior]) -> WordPosterior:
    """Combine the posteriors of several frames by the median of their positions.

    Only frames that show a carrier count for it; `p_null` is their mean. The posteriors may be
    many, and are asked for one at a time, more than once.
    """
    if len(posteriors) == 1:
        [only] = posteriors
        everywhere = np.isfinite(only.position).all(axis=0)
        position = np.where(everywhere, only.position, np.nan)
        return WordPosterior(position, np.where(everywhere, only.p_null, 1.0))
    p_null = np.array([posterior.p_null for posterior in posteriors])
    shown = np.array([np.isfinite(posterior.position).all(axis=0) for posterior in posteriors])
    counts = shown.sum(axis=0)
    known = np.flatnonzero(counts)
    R, C = posteriors[0].position.shape
    median = np.full((R, C), np.nan)
    rows = max(1, POSITIONS_AT_ONCE // max(1, len(posteriors) * len(known)))
    for begin in range(0, R, rows):
        some = slice(begin, begin + rows)
        positions = np.array([posterior.position[some, known] for posterior in posteriors])
        median[some, known] = np.nanmedian(positions, axis=0)
    shared = np.where(shown, p_null, 0.0).sum(axis=0) / np.maximum(counts, 1)
    return WordPosterior(median, np.where(counts > 0, shared, 1.0))


@dataclass(frozen=True, eq=False)
class WordWindows:
    """The words that carriers may hold, and the prior of each.

    Parameters
    ----------
    first : (R, C) int
        First word of each carrier's window.
    prior : (Q, R, C, W) float64
        Prior of each word of the window, for each of `SHIFTS`.
    p_null : (R, C) float64
        Prior of none. With the others it sums to 1.
    """

    first: IntArray
    prior: FloatArray
    p_null: FloatArray

    def log_total_prior(self, shift: IntArray, hypothesis: IntArray) -> FloatArray:
        """Log of the total prior of all assignments that hold no word twice, (N,).

        Parameters are those of `log_mean`.
        """
        known = self._log_total_priors
        new = np.isnan(known[shift, hypothesis])
        if new.any():
            q, r = np.unique(np.stack([shift[new], hypothesis[new]]), axis=1)
            known[q, r] = np.log(assignment_sums(self.first[r], self.prior[q, r], self.p_null[r]))
        return known[shift, hypothesis]

    @cached_property
    def _log_total_priors(self) -> FloatArray:
        """Results of `log_total_prior` so far, (Q, R); NaN where there is none."""
        return np.full(self.prior.shape[:2], np.nan)

    @cached_property
    def hypotheses_by_window(self) -> list[list[tuple[int, IntArray]]]:
        """Of each carrier, first words and the hypotheses that give it a window from there."""
        return [
            [(int(first), np.flatnonzero(of_carrier == first)) for first in np.unique(of_carrier)]
            for of_carrier in self.first.T
        ]

    def most_probable_words(self, n_words: int) -> tuple[IntArray, IntArray]:
        """Find the most probable assignment that holds no word twice, where nothing is shifted.

        Parameters
        ----------
        n_words : int
            M.

        Returns
        -------
        carriers, within : (n,) int
            Carriers that get a word, and which of their window, under the first hypothesis.
        """
        prior, first = self.prior[0, 0], self.first[0]
        log_prior = np.full((len(first), n_words), -_IMPOSSIBLE)
        words = first[:, None] + np.arange(WINDOW_SIZE)
        np.put_along_axis(log_prior, words, np.log(np.maximum(prior, 1e-300)), axis=1)
        carriers, chosen = linear_sum_assignment(log_prior, maximize=True)
        possible = log_prior[carriers, chosen] > -_IMPOSSIBLE
        carriers, chosen = carriers[possible], chosen[possible]
        return carriers, chosen - first[carriers]

    def scores(self, S: NDArray[Any], words: SignArray) -> Iterator[NDArray[Any]]:
        """Sum each word of a carrier's window times its evidence, in S's type.

        Parameters
        ----------
        S : (R, C, K) floating
            Evidence.
        words : (n, M, K) int
            Words of n keys.

        Yields
        ------
        (R, W, n) floating
            Of one carrier after the other: all of them at once fit into no cache.
        """
        R, _, K = S.shape
        signs = np.ascontiguousarray(words.transpose(2, 1, 0), S.dtype)
        for c, windows in enumerate(self.hypotheses_by_window):
            scores = np.empty((R, WINDOW_SIZE, len(words)), S.dtype)
            for first, hypotheses in windows:
                near = signs[:, first : first + WINDOW_SIZE].reshape(K, -1)
                scores[hypotheses] = (S[hypotheses, c] @ near).reshape(-1, *scores.shape[1:])
            yield scores

    def scores_under(self, S: FloatArray, words: SignArray, hypothesis: IntArray) -> FloatArray:
        """Sum as `scores` does, under some hypotheses (n, P) for each key, (n, P, C, W)."""
        index = self.first[hypothesis][..., None] + np.arange(WINDOW_SIZE)
        near = words[np.arange(len(words))[:, None, None, None], index].astype(np.float64)
        return np.einsum("npck,npcwk->npcw", S[hypothesis], near, optimize=True)

    @cached_property
    def prior_over_shifts(self) -> FloatArray:
        """Prior of each word of the window, whatever the shift, (R, C, W)."""
        return np.tensordot(SHIFT_PRIOR, self.prior, axes=1)

    def approximate_log_mean(self, e: FloatArray, hypothesis: IntArray) -> FloatArray:
        """Approximate `log_mean` for every shift, (n, Q, P, T): two carriers may hold one word.

        Parameters
        ----------
        e : (n, P, T, C, W) float64
            E-values under each of P hypotheses.
        hypothesis : (n, P) int
            Which hypotheses those are.
        """
        each = np.einsum("nptcw,qnpcw->nqptc", e, self.prior[:, hypothesis], optimize=True)
        return np.log(each + self.p_null[hypothesis][:, None, :, None]).sum(axis=-1)

    def log_mean(self, e: FloatArray, shift: IntArray, hypothesis: IntArray) -> FloatArray:
        """Average prod e[c, word of c] over the assignments that hold no word twice.

        Parameters
        ----------
        e : (N, C, W) float64
            E-value of each word of a carrier's window.
        shift, hypothesis : (N,) int
            The shift and the hypothesis of each row.

        Returns
        -------
        (N,) float64
            Log of the mean. Words of a random key are independent, so that the product for one
            assignment is an e-value; a carrier without a word contributes 1; and means of
            e-values are e-values.
        """
        scale = np.maximum(e.max(axis=-1), 1.0)
        x = self.prior[shift, hypothesis] * (e / scale[..., None])
        summed = assignment_sums(self.first[hypothesis], x, self.p_null[hypothesis] / scale)
        mean: FloatArray = np.log(summed) + np.log(scale).sum(axis=-1)
        return mean - self.log_total_prior(shift, hypothesis)


def assignment_sums(first: IntArray, x: FloatArray, idle: FloatArray) -> FloatArray:
    """Sum prod x[c, word of c] over all assignments that hold no word twice, (N,).

    The sum is a permanent of a banded matrix. Carriers are taken in the order of their windows, so
    that words before the present window can never be used again: a dynamic program over the
    subsets of the window's words, C W 2^W steps, computes it.

    Parameters
    ----------
    first : (N, C) int
        First word of each carrier's window.
    x : (N, C, W) float64
        Factor of each word of the window.
    idle : (N, C) float64
        Factor of a carrier without a word.
    """
    sums = [
        _some_assignment_sums(first[some], x[some], idle[some])
        for some in (slice(start, start + ROWS_AT_ONCE) for start in range(0, len(x), ROWS_AT_ONCE))
    ]
    return np.concatenate(sums) if sums else np.zeros(0)


def _some_assignment_sums(first: IntArray, x: FloatArray, idle: FloatArray) -> FloatArray:
    order = np.argsort(first, axis=-1, kind="stable")
    first = np.take_along_axis(first, order, axis=-1)
    x = np.take_along_axis(x, order[..., None], axis=-2)
    idle = np.take_along_axis(idle, order, axis=-1)
    steps = np.minimum(np.diff(first, axis=-1, prepend=first[:, :1]), WINDOW_SIZE)
    # Rows last: what is done to all of them at once then runs along memory.
    x, idle = np.ascontiguousarray(x.transpose(1, 2, 0)), np.ascontiguousarray(idle.T)
    table = np.zeros((1 << WINDOW_SIZE, len(first)))
    table[0] = 1.0
    for c in range(len(x)):
        table = with_carrier(_advance_window(table, steps[:, c]), x[c], idle[c])
    return table.sum(axis=0)


def _advance_window(table: FloatArray, steps: IntArray) -> FloatArray:
    """Forget the first words of the window, as many as each step (N,), in tables (2^W, N)."""
    result = table.copy()
    for step in np.unique(steps[steps > 0]).tolist():
        rows = np.flatnonzero(steps == step)
        kept = 1 << (WINDOW_SIZE - step)
        result[:kept, rows] = table[:, rows].reshape(kept, 1 << step, len(rows)).sum(axis=1)
        result[kept:, rows] = 0.0
    return result
