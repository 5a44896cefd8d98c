"""Which of many keys and names may be found in evidence: a quick bound, before few are judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.detection.decision import corrected_for
from meshmark.detection.evidence import Evidence
from meshmark.detection.gathering import AssetEvidence
from meshmark.detection.joint_verdict import joint_log10_p
from meshmark.detection.pooling import Pool
from meshmark.detection.significance import ROUNDING, log10_p_of, screened
from meshmark.detection.verdict import Answer
from meshmark.keys import signs_of
from meshmark.statistics.p_values import word_log_e_means
from meshmark.statistics.screening import Screen
from meshmark.statistics.sieve import MOST_CHIPS, Octets, Sieve


@dataclass(frozen=True, eq=False)
class WordsNeeded:
    """Words that are asked for of a scheme.

    Parameters
    ----------
    n_words, n_chips : int
        How many words the scheme has, and chips of the longest.
    numbers : (U,) int
        Which of the words, in order.
    """

    n_words: int
    n_chips: int
    numbers: IntArray

    def joined(self, other: WordsNeeded | None) -> WordsNeeded:
        """Ask for what either asks for."""
        if other is None:
            return self
        return WordsNeeded(
            max(self.n_words, other.n_words),
            max(self.n_chips, other.n_chips),
            np.union1d(self.numbers, other.numbers),
        )


@dataclass(frozen=True, eq=False)
class KeyWords:
    """Some words of n keys or names by one scheme.

    Parameters
    ----------
    numbers : (U,) int
        Which of the words, in order.
    octets : (n, U, B) uint8
        Their chips as bits, the most significant first.
    """

    numbers: IntArray
    octets: Octets

    def some(self, numbers: IntArray, n_chips: int) -> Octets:
        """Take some of the words, (n, len(numbers), B) with fewer bytes."""
        at = np.searchsorted(self.numbers, numbers)
        return self.octets.take(at, axis=1)[..., : -(-n_chips // 8)]

    def of(self, keys: IntArray) -> KeyWords:
        """Keep those of some keys or names."""
        return KeyWords(self.numbers, self.octets[keys])


class KeyScreen:
    """Tells which of many keys and names may be found in the evidence of a source.

    Whoever `judge_all` would say is marked may be found. There is one exception: single frames,
    which are judged by themselves too, count for nothing here. A quick bound comes first, exact
    numbers then for those that are left.

    Parameters
    ----------
    evidence : AssetEvidence
    n_names : int
        Names tried of each key, the owner included.
    fpr : float
        The share of the rate that each key has.
    n_pairs : int
        Keys and names times sources that are tried in all.
    """

    def __init__(self, evidence: AssetEvidence, n_names: int, fpr: float, n_pairs: int = 0) -> None:
        self._log10_fpr = float(np.log10(fpr))
        sides = _sides(evidence)
        # Weak evidence of either side may count together with the other's.
        limit = self._log10_fpr if len(sides) == 1 else None
        self._sides = [_Side(items, n * n_names, limit, n_pairs) for items, n in sides]
        self.needed: dict[str, WordsNeeded] = {}
        for side in self._sides:
            for one in side.tried:
                known = self.needed.get(one.scheme)
                self.needed[one.scheme] = one.needed.joined(known)

    def may_be_found(self, words: Mapping[str, KeyWords], n: int) -> BoolArray:
        """Tell who may be found, (n,).

        Parameters
        ----------
        words : mapping of str to KeyWords
            By scheme, of n keys or names: at least what is `needed`.
        """
        found = self._pass(words, n, exactly=False)
        left = np.flatnonzero(found)
        if len(left):
            some = {scheme: known.of(left) for scheme, known in words.items()}
            found[left] = self._pass(some, len(left), exactly=True)
        return found

    def _pass(self, words: Mapping[str, KeyWords], n: int, *, exactly: bool) -> BoolArray:
        each = np.array([side.log10_p(words, n, exactly) for side in self._sides])
        log10_p = each[0] if len(each) == 1 else joint_log10_p(each)
        return np.asarray(log10_p <= self._log10_fpr)

    @property
    def answer(self) -> Answer:
        """What is to be said where nobody is found."""
        reachable = self._sides[-1].reachable
        return "inconclusive" if reachable > self._log10_fpr else "not marked"


def _sides(evidence: AssetEvidence) -> list[tuple[list[Evidence], int]]:
    """Part evidence into what `judge_all` judges by itself, each with its number of schemes."""
    alone = [item for item in evidence.items if item.informed is None]
    blind = (alone, max(1, evidence.n_schemes))
    if evidence.original is None:
        return [blind]
    beside = [item for item in evidence.items if item.informed is not None]
    informed = (beside, max(1, len({item.scheme for item in beside})))
    return [blind, informed] if evidence.n_schemes else [informed]


@dataclass(frozen=True, eq=False)
class _Tried:
    """A mesh, part or pool that words are tried on.

    Parameters
    ----------
    scheme : str
    needed : WordsNeeded
    correction : float
        What log10 p is corrected by.
    bound, exact : callable
        Bounds log10 p of words (n, U, B) from below, roughly or closely, before it is corrected.
    """

    scheme: str
    needed: WordsNeeded
    correction: float
    bound: Callable[[Octets], FloatArray]
    exact: Callable[[Octets], FloatArray]

    def log10_p(self, words: Mapping[str, KeyWords], exactly: bool) -> FloatArray:
        mine = words[self.scheme].some(self.needed.numbers, self.needed.n_chips)
        return (self.exact if exactly else self.bound)(mine) + self.correction


class _Side:
    """What is judged by itself: meshes, parts and pools, by every scheme."""

    def __init__(
        self,
        items: Sequence[Evidence],
        hypotheses: float,
        log10_limit: float | None,
        n_pairs: int,
    ) -> None:
        corrections, pools = corrected_for(items, float(np.log10(hypotheses)))
        held = [
            (item, float(correction))
            for item, correction in zip(items, corrections, strict=True)
            if item.held.any()
        ]
        self.tried = [
            *(_item(item, correction, log10_limit, n_pairs) for item, correction in held),
            *(_pool(pool, correction) for pool, correction in pools),
        ]
        self.reachable = min(
            (
                *(item.reachable_log10_p + correction for item, correction in held),
                *(pool.reachable_log10_p + correction for pool, correction in pools),
            ),
            default=0.0,
        )

    def log10_p(self, words: Mapping[str, KeyWords], n: int, exactly: bool) -> FloatArray:
        """Bound log10 p of n keys or names from below, corrected, (n,); 0 where nothing is held."""
        each = [one.log10_p(words, exactly) for one in self.tried]
        return np.minimum(0.0, np.min(each, axis=0)) if each else np.zeros(n)


def _item(item: Evidence, correction: float, log10_limit: float | None, n_pairs: int) -> _Tried:
    """Choose how the words of a mesh or part are bounded; None as a limit is for any."""
    parts = screened(item)
    if not parts:
        needed = WordsNeeded(item.n_words, item.n_chips, np.arange(item.n_words))

        def of_item(octets: Octets) -> FloatArray:
            return log10_p_of(item, signs_of(octets, item.n_chips))

        return _Tried(item.scheme, needed, correction, of_item, of_item)
    if log10_limit is None or item.carriers * item.n_chips > MOST_CHIPS:
        # Whatever reaches 0 counts.
        screen = Screen(parts, item.n_words, float(correction * np.log(10.0)))
        needed = WordsNeeded(item.n_words, item.n_chips, screen.words)

        def bound(octets: Octets) -> FloatArray:
            log_e = screen.log_e_bounds(signs_of(octets, item.n_chips))
            return -log_e / np.log(10.0) - ROUNDING

        def reached(octets: Octets) -> BoolArray:
            return screen.bounds_by_part(signs_of(octets, item.n_chips)) > -np.inf
    else:
        least = float((correction - log10_limit) * np.log(10.0))
        sieve = Sieve(parts, item.n_words, least, n_pairs)
        needed = WordsNeeded(item.n_words, item.n_chips, sieve.words)
        reached = sieve.passed

        def bound(octets: Octets) -> FloatArray:
            return np.where(reached(octets).any(axis=0), -np.inf, np.inf)

    def exact(octets: Octets) -> FloatArray:
        # No other words are looked at.
        words = np.zeros((len(octets), item.n_words, item.n_chips), np.int8)
        words[:, needed.numbers] = signs_of(octets, item.n_chips)
        found = np.full(len(words), -np.inf)
        for part, of_part in zip(parts, reached(octets), strict=True):
            some = np.flatnonzero(of_part)
            if len(some):
                of_some = word_log_e_means(part.S, part.log_prior, words[some], part.posterior)
                found[some] = np.maximum(found[some], of_some)
        # All are worth no more than as many of the best of them.
        return -(found + np.log(len(parts))) / np.log(10.0) - ROUNDING

    return _Tried(item.scheme, needed, correction, bound, exact)


def _pool(pool: Pool, correction: float) -> _Tried:
    needed = WordsNeeded(pool.n_words, pool.n_chips, np.arange(pool.n_words))

    def bound(octets: Octets) -> FloatArray:
        log_e = pool.log_e_bounds(signs_of(octets, pool.n_chips))
        return -log_e / np.log(10.0) - ROUNDING

    def exact(octets: Octets) -> FloatArray:
        return pool.log10_p(signs_of(octets, pool.n_chips))

    return _Tried(pool.scheme, needed, correction, exact if pool.n_words == 1 else bound, exact)
