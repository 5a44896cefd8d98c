"""Whoever would be found passes the screen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logsumexp

from meshmark.statistics.p_values import word_log_e_means
from meshmark.statistics.screening import FEW, Screen, Screened, worth_judging
from meshmark.statistics.word_windows import WordPosterior

M = 12


@st.composite
def evidence(draw: st.DrawFn) -> tuple[Screened, ...]:
    """Evidence read in one or two ways, weak or strong, with some chips and carriers missing."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    C, K = draw(st.integers(1, 5)), draw(st.integers(1, 20))
    found = []
    for R in draw(st.lists(st.integers(1, 6), min_size=1, max_size=2)):
        size = draw(st.sampled_from([0.01, 0.3, 1.0]))
        S = np.clip(size * rng.normal(size=(R, C, K)), -1, 1)
        S[rng.random(S.shape) < draw(st.sampled_from([0.0, 0.5, 1.0]))] = 0.0
        place = rng.uniform(0, M - 1, size=(R, C))
        place[:, rng.random(C) < 0.2] = np.nan
        prior = rng.dirichlet(np.ones(R)) * rng.uniform(0.1, 0.5)
        where = WordPosterior(place, rng.uniform(0.01, 1.0, size=C))
        found.append(Screened(S, np.log(np.maximum(prior, 1e-30)), where))
    return tuple(found)


def exact(items: tuple[Screened, ...], words: np.ndarray) -> np.ndarray:
    each = [word_log_e_means(item.S, item.log_prior, words, item.posterior) for item in items]
    return logsumexp(each, axis=0)


def some_words(items: tuple[Screened, ...], rng: np.random.Generator) -> np.ndarray:
    """Random words, and words that fit one hypothesis as well as any could."""
    C, K = items[0].S.shape[1:]
    words = 2 * rng.integers(0, 2, size=(20, M, K)) - 1
    for n, item in enumerate(items * 5):
        r, first = n % len(item.S), item.posterior.first_words(M)
        for c in range(C):
            best = np.where(item.S[r, c] >= 0, 1, -1)
            words[n, first[r, c] + rng.integers(0, 8)] = best
    return words.astype(np.int8)


@settings(max_examples=60, deadline=None)
@given(evidence(), st.integers(0, 1000), st.floats(-5.0, 60.0))
def test_no_bound_is_below_what_it_bounds(items, seed, least) -> None:
    words = some_words(items, np.random.default_rng(seed))
    wanted = exact(items, words)
    screen = Screen(items, M, -np.inf)
    assert np.all(screen.log_e_bounds(words[:, screen.words]) >= wanted)
    # What cannot matter need not be computed; what does is never lost.
    screen = Screen(items, M, least)
    bounds = screen.log_e_bounds(words[:, screen.words])
    assert np.all((bounds >= wanted) | (wanted < least))


def test_random_words_are_bounded_far_below_the_right_ones() -> None:
    rng = np.random.default_rng(3)
    words = (2 * rng.integers(0, 2, size=(2000, 96, 16)) - 1).astype(np.int8)
    S = 0.4 * rng.normal(size=(50, 6, 16))
    place = rng.uniform(20.0, 40.0, size=(50, 6))
    place[7] = np.arange(30, 36)
    S[7] += 0.5 * words[1234, 30:36]
    item = Screened(
        np.clip(S, -1, 1), np.full(50, -np.log(50)), WordPosterior(place, np.full(6, 0.2))
    )
    decades = np.log(10.0)
    screen = Screen([item], 96, 9 * decades)
    bounds = screen.log_e_bounds(words[:, screen.words])
    assert len(screen.words) < 40
    passed = np.flatnonzero(bounds >= screen.least)
    assert 1234 in passed
    assert len(passed) < 20
    assert exact((item,), words[[1234]])[0] > screen.least
    assert 1234 in worth_judging(bounds, screen.least)
    assert len(worth_judging(bounds, screen.least)) == FEW


@pytest.mark.parametrize("n", [0, 1])
def test_nobody_and_one(n) -> None:
    item = Screened(
        np.ones((1, 1, 4)), np.zeros(1), WordPosterior(np.full((1, 1), 5.0), np.ones(1))
    )
    screen = Screen([item], M, 0.0)
    assert screen.log_e_bounds(np.ones((n, len(screen.words), 4), np.int8)).shape == (n,)
    assert len(worth_judging(np.zeros(n), 1.0)) == n
