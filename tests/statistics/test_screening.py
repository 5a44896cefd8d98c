"""Whoever would be found passes the screen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.statistics.screening import FEW, Screen, Screened, worth_judging
from meshmark.statistics.word_windows import WordPosterior
from screened_evidence import M, evidence, exact, some_words


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
