"""Whoever reaches a log e-value passes the sieve; loops and numpy let the same pass."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.kernels import load_loops
from meshmark.statistics import sieve
from meshmark.statistics.screening import Screened
from meshmark.statistics.sieve import LANES, Sieve
from meshmark.statistics.word_windows import WordPosterior, assignment_sums
from screened_evidence import M, evidence, exact, some_words


def packed(words: np.ndarray, some: Sieve) -> np.ndarray:
    return np.packbits(words[:, some.words] > 0, axis=-1)


@settings(max_examples=40, deadline=None)
@given(evidence(), st.integers(0, 1000), st.floats(-5.0, 60.0))
def test_whoever_reaches_it_passes(items, seed, least) -> None:
    words = some_words(items, np.random.default_rng(seed))
    some = Sieve(items, M, least, 0)
    passed = some.passed(packed(words, some))
    assert passed.shape == (len(items), len(words))
    assert np.all(passed.any(axis=0) | (exact(items, words) < least))


def stored(R: int, C: int, size: float, seed: int) -> tuple[Screened, np.ndarray]:
    """Evidence in whole steps as it is stored, and words of keys of which one fits."""
    rng = np.random.default_rng(seed)
    words = (2 * rng.integers(0, 2, size=(300, 96, 16)) - 1).astype(np.int8)
    S = size * rng.normal(size=(R, C, 16))
    place = rng.uniform(20.0, 40.0, size=(R, C))
    place[R // 2] = 30 + 2 * np.arange(C)
    S[R // 2] += 0.5 * words[123, 30 : 30 + 2 * C : 2]
    S = np.rint(127 * np.clip(S, -1, 1)) / 127
    where = WordPosterior(place, np.full(C, 0.2))
    return Screened(S, np.full(R, -np.log(R)), where), words


def test_random_keys_are_left_out() -> None:
    item, words = stored(50, 6, 0.4, 3)
    some = Sieve([item], 96, 9 * np.log(10.0), 0)
    assert len(some.words) < 40
    [passed] = some.passed(packed(words, some))
    assert np.flatnonzero(passed).tolist() == [123]


# The loops are compiled for it.
@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(
    R=st.integers(1, 2 * LANES + 1),
    C=st.integers(1, 10),
    size=st.sampled_from([0.1, 0.4]),
    decades=st.floats(0.0, 12.0),
    seed=st.integers(0, 2**32 - 1),
)
def test_loops_find_the_same_as_numpy(R, C, size, decades, seed) -> None:
    pytest.importorskip("numba")
    item, words = stored(R, C, size, seed)
    found = []
    for n_pairs in (0, sieve.MANY):
        some = Sieve([item], 96, decades * np.log(10.0), n_pairs)
        found.append(some._reached(some._parts[0], packed(words, some)))
    np.testing.assert_array_equal(*found)
    assert (some._loops is None) == (n_pairs < sieve.MANY)


@pytest.mark.parametrize("n_pairs", [0, sieve.MANY])
@pytest.mark.parametrize("n", [0, 1])
def test_nobody_and_one(n, n_pairs) -> None:
    item, words = stored(3, 2, 0.1, 1)
    some = Sieve([item], 96, 1.0, n_pairs)
    assert some.passed(packed(words[:n], some)).shape == (1, n)
    never = Sieve([item], 96, 1e9, n_pairs)
    assert not never.passed(packed(words[:n], never)).any()


@settings(max_examples=10, deadline=None)
@given(evidence(), st.floats(0.5, 127.0), st.integers(0, 2**32 - 1))
def test_what_bounds_are_made_of_is_the_same_in_loops(items, scale, seed) -> None:
    pytest.importorskip("numba")
    loops = load_loops(sieve.LOOPS)
    levels = np.random.default_rng(seed).random((int(scale) + 1, 8))
    for item in items:
        found = loops.in_steps(item.S, scale, levels)
        wanted = sieve.in_steps(item.S, scale, levels)
        np.testing.assert_array_equal(found[0], wanted[0])
        for one, other in zip(found, wanted, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-12)
        windows = item.posterior.windows(M)
        arguments = windows.first, windows.prior[0], windows.p_null
        sums = loops.assignment_sums(*arguments)
        np.testing.assert_allclose(sums, assignment_sums(*arguments), rtol=1e-12)
