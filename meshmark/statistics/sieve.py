"""Which of many keys could reach a log e-value at all, told in whole numbers, from tables.

The bound is that of `meshmark.statistics.screening`, with a line for each tilt. Evidence is rounded
to whole steps, so that a word's score is a sum of a few numbers looked up in tables: one table for
each byte of a word. Hypotheses whose windows are alike stand side by side in blocks, and what is
done to one of a block is done to all of it at once. Carrier by carrier, a key that can no longer
reach what matters under any hypothesis of a block is left out of the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.kernels import load_loops
from meshmark.statistics.e_values import N_TOP_TERMS, TILTS, e_values, log_cosh
from meshmark.statistics.screening import LOG_WEIGHT, ROUNDING, Screened
from meshmark.statistics.word_windows import (
    SHIFT_PRIOR,
    WINDOW_SIZE,
    WordPosterior,
    assignment_sums,
)

LOOPS = "meshmark.statistics.loops"
# Keys times sources that take longer in numpy than loops take to be imported, or compiled.
MANY = 200_000
# Hypotheses of a block.
LANES = 96
# Bytes of a word that the loop is made for.
LOOP_BYTES = 2
# Steps from 0 to 1, as evidence is stored; fewer where sums of them would not fit into 16 bits.
STEPS, LARGEST_SUM = 127.0, 30_000.0
# Chips of all carriers that there are steps enough for.
MOST_CHIPS = 10_000
# Stands for what no sum reaches.
_NEVER = np.iinfo(np.int16).max
# Products that are known to be whole numbers miss them by less.
TINY = 1e-6
# Keys whose sums fit into a processor's cache; pairs of keys and hypotheses that are looked at
# again at once, which bounds memory.
KEYS_AT_ONCE, PAIRS_AT_ONCE = 512, 512

Steps = NDArray[np.int16]
Octets = NDArray[np.uint8]


class Sieve:
    """Tells which keys may reach a log e-value on what several ways to read a mesh say.

    Parameters
    ----------
    evidence : sequence of Screened
        One for each way to read it, at least one; the e-value is the sum of theirs.
    n_words : int
        M, the words of a key.
    least : float
        The log e-value, finite.
    n_pairs : int
        Keys times sources that are tried in all: of many, compiled loops do the work.

    Attributes
    ----------
    words : (U,) int
        Which of a key's words are asked for.
    """

    def __init__(
        self, evidence: Sequence[Screened], n_words: int, least: float, n_pairs: int
    ) -> None:
        firsts = [item.posterior.first_words(n_words) for item in evidence]
        begins = np.unique(np.concatenate([first.ravel() for first in firsts]))
        self.words: IntArray = np.unique(begins[:, None] + np.arange(WINDOW_SIZE))
        self._n_words = n_words
        self._loops = load_loops(LOOPS) if n_pairs >= MANY else None
        # Of n that sum up to e^x, one is at least e^x / n.
        self._least = least - float(np.log(len(evidence)))
        self._parts = [
            _Part.of(item, np.searchsorted(self.words, first), self._least, self._loops)
            for item, first in zip(evidence, firsts, strict=True)
        ]

    def passed(self, octets: Octets) -> BoolArray:
        """Tell whether each of n keys may reach it by each way to read the mesh, (P, n).

        Parameters
        ----------
        octets : (n, U, B) uint8
            Of each key, the words that `words` lists: a bit a chip, the most significant first.
        """
        # Loops compile once for each layout that they get.
        octets = np.require(octets, np.uint8, ["C", "W"])
        found = np.zeros((len(self._parts), len(octets)), np.bool_)
        for start in range(0, len(octets), KEYS_AT_ONCE):
            some = octets[start : start + KEYS_AT_ONCE]
            for part, of_part in zip(self._parts, found, strict=True):
                of_part[start + self._passing(part, some)] = True
        return found

    def _passing(self, part: _Part, octets: Octets) -> IntArray:
        """List keys that may reach it, some of them more than once."""
        keys, hypotheses = self._reached(part, octets)
        portions = (slice(n, n + PAIRS_AT_ONCE) for n in range(0, len(keys), PAIRS_AT_ONCE))
        left = [self._left(part, octets, keys[some], hypotheses[some]) for some in portions]
        return np.concatenate([keys[:0], *left])

    def _reached(self, part: _Part, octets: Octets) -> tuple[IntArray, IntArray]:
        """List pairs of keys and hypotheses that may reach it."""
        loops = self._loops if octets.shape[-1] == LOOP_BYTES else None
        list_pairs = reached if loops is None else loops.reached
        pairs = list_pairs(part.steps, part.windows, part.zeros, part.needed, octets)
        return pairs[:, 0], part.hypotheses[pairs[:, 1]]

    def _left(self, part: _Part, octets: Octets, keys: IntArray, hypotheses: IntArray) -> IntArray:
        """List the keys of those pairs that may reach it when their own windows are looked at."""
        first = part.first[hypotheses][..., None] + np.arange(WINDOW_SIZE)
        S = part.item.S[hypotheses]
        bits = np.unpackbits(octets[keys[:, None, None], first], axis=-1, count=S.shape[-1])
        score = np.einsum("nck,ncwk->ncw", S, 2.0 * bits - 1.0)
        log_e = TILTS[:, None] * score.max(axis=-1).T[:, None] - part.log_null[..., hypotheses]
        bounds = np.maximum(log_e, 0.0).sum(axis=0).max(axis=0) + LOG_WEIGHT
        needed = self._least - ROUNDING - part.item.log_prior[hypotheses]
        near = np.flatnonzero(bounds >= needed)
        if len(near):
            bounds[near] = self._close_bounds(part, score[near], hypotheses[near])
        return keys[bounds >= needed]

    def _close_bounds(self, part: _Part, score: FloatArray, hypotheses: IntArray) -> FloatArray:
        """Bound log e-values of scores (N, C, W) by how likely carriers hold each word, (N,).

        Assignments in which two carriers hold one word are counted, too. The terms of the mean are
        worth no more than as many of the largest; priors of hypotheses are left out.
        """
        used, at = np.unique(hypotheses, return_inverse=True)
        posterior = part.item.posterior
        some = WordPosterior(posterior.position[used], posterior.p_null).windows(self._n_words)
        e = e_values(score[:, None], part.log_null[..., hypotheses].T, TILTS)
        bounds = some.approximate_log_mean(e[:, None], at[:, None])[:, :, 0].max(axis=-1)
        sums = assignment_sums if self._loops is None else self._loops.assignment_sums
        total = [sums(some.first, prior, some.p_null) for prior in some.prior]
        bounds += np.log(SHIFT_PRIOR * N_TOP_TERMS / len(TILTS)) - np.log(total).T[at]
        return np.asarray(bounds.max(axis=-1))


@dataclass(frozen=True, eq=False)
class _Part:
    """One way to read a mesh, in G blocks of those hypotheses that can reach what matters.

    Parameters
    ----------
    item : Screened
        Hypotheses whose windows begin alike come together, carriers that say most come first; of
        those whose position is not known, nothing is left.
    first : (R, C) int
        Where windows begin.
    log_null : (C, T, R) float64
        Sum of log cosh of tilt times evidence, or less.
    hypotheses : (H,) int
        Which of them stand in blocks, in that order.
    steps : (G, C, 8 B, L) int16
        Evidence.
    windows : (G, C, 2) int
        First word of the windows of any hypothesis of a block, and the first behind them.
    zeros : (G, C, J, L) int16
        Scores from which on the log e-value of a tilt is above 0.
    needed : (G, C, J, L) int16
        What the sum of scores above zeros must have reached after each carrier.
    """

    item: Screened
    first: IntArray
    log_null: FloatArray
    hypotheses: IntArray
    steps: Steps
    windows: IntArray
    zeros: Steps
    needed: Steps

    @classmethod
    def of(cls, item: Screened, first: IntArray, least: float, loops: ModuleType | None) -> _Part:
        c = np.argsort(-np.abs(item.S).sum(axis=(0, 2)), kind="stable")
        r = np.lexsort(first.T)
        rc = r[:, None], c
        first, position = first[rc], item.posterior.position[rc]
        S = np.where(np.isfinite(position)[..., None], item.S[rc], 0.0)
        item = Screened(S, item.log_prior[r], WordPosterior(position, item.posterior.p_null[c]))
        scale = min(STEPS, LARGEST_SUM / S[0].size - 1.0)
        levels = log_cosh(np.arange(int(scale) + 1)[:, None] / scale * TILTS)
        sums = in_steps if loops is None else loops.in_steps
        steps, size, rounding, log_null = sums(S, scale, levels)
        unit = (scale / TILTS)[:, None]
        zeros = np.floor(log_null * unit - rounding[:, None] + TINY)
        most = np.maximum(size[:, None] - zeros, 0.0)
        wanted = unit * (least - LOG_WEIGHT - ROUNDING - item.log_prior)
        matters = most.sum(axis=0) >= wanted
        kept, j = np.flatnonzero(matters.any(axis=0)), np.flatnonzero(matters.any(axis=1))
        most = most[:, j]
        needed = wanted[j] - most.sum(axis=0) + most.cumsum(axis=0)
        begins = _in_blocks(first.T[:, None], kept, None)[:, :, 0].astype(np.int64)
        return cls(
            item,
            first,
            log_null,
            kept,
            _in_blocks(steps, kept),
            np.stack([begins.min(axis=-1), begins.max(axis=-1) + WINDOW_SIZE], axis=-1),
            _in_blocks(zeros[:, j], kept),
            _in_blocks(np.clip(np.ceil(needed), -_NEVER, _NEVER), kept, _NEVER),
        )


def in_steps(
    S: FloatArray, scale: float, levels: FloatArray
) -> tuple[Steps, FloatArray, FloatArray, FloatArray]:
    """Round evidence (R, C, K) to whole steps, and sum over chips what bounds are made of.

    Parameters
    ----------
    scale : float
        Steps from 0 to 1.
    levels : (V, T) float64
        Log cosh of tilts times numbers of steps.

    Returns
    -------
    steps : (C, 8 B, R) int16
        Chips are filled up to whole bytes.
    size, rounding : (C, R) float64
        Sums of magnitudes, and of what they were rounded by, in steps.
    log_null : (C, T, R) float64
        Sums of log cosh of tilts times evidence, rounded down to whole steps.
    """
    R, C, K = S.shape
    exact = scale * S.transpose(1, 2, 0)
    rounded, magnitude = np.rint(exact), np.abs(exact)
    below = np.floor(magnitude + TINY).astype(np.int64)
    log_null = np.stack([of_tilt[below].sum(axis=1) for of_tilt in levels.T], axis=1)
    size, rounding = np.abs(rounded).sum(axis=1), np.abs(exact - rounded).sum(axis=1)
    steps = np.zeros((C, -(-K // 8) * 8, R), np.int16)
    steps[:, :K] = rounded
    return steps, size, rounding, log_null


def _in_blocks(numbers: NDArray[Any], kept: IntArray, rest: int | None = 0) -> Steps:
    """Put some of R numbers (C, X, R) into blocks (G, C, X, L).

    The last block is filled up with the rest, or the last number.
    """
    C, X, R = numbers.shape
    n, G = len(kept), -(-len(kept) // LANES)
    some = numbers if n == R else numbers[..., kept]
    filled = np.empty((C, X, G * LANES), np.int16)
    filled[..., :n] = some
    filled[..., n:] = some[..., -1:] if rest is None else rest
    return np.ascontiguousarray(filled.reshape(C, X, G, LANES).transpose(2, 0, 1, 3))


def reached(
    steps: Steps, windows: IntArray, zeros: Steps, needed: Steps, octets: Octets
) -> IntArray:
    """List pairs of keys and hypotheses, both numbered, that have reached what is needed, (N, 2).

    Parameters are those of `_Part`, and the words of n keys (n, U, B).
    """
    found = [np.zeros((0, 2), np.int64)]
    G, C, _, L = steps.shape
    for g in range(G):
        left = np.arange(len(octets))
        total = np.zeros((zeros.shape[2], len(left), L), np.int16)
        for c in range(C):
            best = _best_scores(steps[g, c], octets[left, windows[g, c, 0] : windows[g, c, 1]])
            zero = zeros[g, c][:, None]
            total += np.maximum(best, zero) - zero
            enough = total >= needed[g, c][:, None]
            alive = enough.any(axis=(0, 2))
            left, total = left[alive], total[:, alive]
        key, lane = np.nonzero(enough[:, alive].any(axis=0))
        found.append(np.stack([left[key], g * L + lane], axis=-1))
    return np.concatenate(found)


def _best_scores(steps: Steps, near: Octets) -> Steps:
    """Score words (n, W, B) on evidence (8 B, L), and take the best of each window, (n, L)."""
    tables = [_table(eight) for eight in steps.reshape(-1, 8, steps.shape[-1])]
    best = np.full((len(near), steps.shape[-1]), -_NEVER, np.int16)
    for word in near.transpose(1, 2, 0):
        score = sum(table[octet] for table, octet in zip(tables, word, strict=True))
        np.maximum(best, score, out=best)
    return best


def _table(steps: Steps) -> Steps:
    """Sum eight chips (8, L) by the signs that each byte stands for, (256, L)."""
    table = np.zeros((1, steps.shape[-1]), np.int16)
    for chip in steps[::-1]:
        table = np.concatenate([table - chip, table + chip])
    return table
