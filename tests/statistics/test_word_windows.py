"""Words by their positions: priors, sums against brute force, and p-values of random keys."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from meshmark.statistics import window_mean
from meshmark.statistics.p_values import (
    log10_p_words,
    reachable_log10_p,
    word_log_e_bounds,
    word_log_e_means,
)
from meshmark.statistics.word_windows import (
    SHIFT_PRIOR,
    SHIFTS,
    WINDOW_SIZE,
    WordPosterior,
    WordWindows,
    median_posterior,
)

M = 20


def posterior(position, p_null=0.2) -> WordPosterior:
    position = np.atleast_2d(np.array(position, dtype=float))
    return WordPosterior(position, np.full(position.shape[1], p_null))


def brute_mean(windows, e, shift, hypothesis) -> float:
    """Average over every way to give carriers words, written out."""
    total = ways = 0.0
    first, p_null = windows.first[hypothesis], windows.p_null[hypothesis]
    for way in product([None, *range(WINDOW_SIZE)], repeat=len(first)):
        words = [first[c] + w for c, w in enumerate(way) if w is not None]
        if len(set(words)) < len(words):
            continue
        prior = value = 1.0
        for c, w in enumerate(way):
            prior *= p_null[c] if w is None else windows.prior[shift, hypothesis, c, w]
            value *= 1.0 if w is None else e[c, w]
        ways += prior
        total += prior * value
    return float(np.log(total / ways))


@pytest.mark.parametrize(
    "positions", [[3.2, 3.4, 3.9], [0.0, 19.0, 9.5], [12.0, 4.1, 5.0], [7.7, 7.7, 7.7, 7.7]]
)
def test_the_mean_is_over_all_assignments_in_which_no_word_is_held_twice(positions) -> None:
    rng = np.random.default_rng(0)
    windows = posterior([positions, positions[::-1]]).windows(M)
    e = np.exp(rng.normal(size=(5, len(positions), WINDOW_SIZE)))
    shift, hypothesis = np.array([3, 1, 0, 1, 0]), np.array([0, 1, 0, 1, 1])
    found = windows.log_mean(e, shift, hypothesis)
    wanted = [brute_mean(windows, e[i], shift[i], hypothesis[i]) for i in range(5)]
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


def test_priors_sum_to_one_and_fall_with_the_distance_from_the_position() -> None:
    windows = posterior([0.3, 9.8, 19.0, np.nan]).windows(M)
    sums = windows.prior.sum(axis=-1) + windows.p_null
    np.testing.assert_allclose(sums, 1.0)
    assert windows.first.min() >= 0
    assert windows.first.max() <= M - WINDOW_SIZE
    near = windows.first[0, 1] + np.argsort(-windows.prior[0, 0, 1])[:2]
    assert near.tolist() == [10, 9]
    # Nobody knows where the last one stands: it holds nothing.
    assert windows.p_null[0, 3] == 1.0
    assert not windows.prior[:, 0, 3].any()
    assert SHIFT_PRIOR.sum() == pytest.approx(1.0)
    assert (SHIFTS[0], SHIFT_PRIOR.argmax()) == (0.0, 0)


def test_a_shift_moves_all_carriers_alike() -> None:
    windows = posterior([6.0, 12.0]).windows(M)
    up = int(np.flatnonzero(SHIFTS == 1.0)[0])
    assert (windows.first + windows.prior[0, 0].argmax(axis=-1)).tolist() == [[6, 12]]
    assert (windows.first + windows.prior[up, 0].argmax(axis=-1)).tolist() == [[7, 13]]


def test_a_word_where_it_is_expected_is_worth_more_than_elsewhere() -> None:
    rng = np.random.default_rng(1)
    words = 2 * rng.integers(0, 2, size=(M, 16)) - 1
    S = 0.9 * words[[4, 9, 15]][None].astype(float)
    scores = [
        log10_p_words(S, words, posterior=posterior(positions))
        for positions in ([4.1, 9.2, 14.8], [5.8, 11.0, 16.9], [9.0, 15.0, 4.0])
    ]
    assert scores[0] < scores[1] < scores[2]
    assert scores[0] < -9.0
    assert scores[2] > -1.0


def test_p_is_honest_where_words_have_positions() -> None:
    n = 3000
    rng = np.random.default_rng(2)
    words = 2 * rng.integers(0, 2, size=(n, M, 12)) - 1
    S = np.clip(rng.normal(size=(2, 4, 12)), -1, 1)
    where = posterior([[3.0, 3.1, 3.2, 12.0], [3.0, 4.0, 5.0, 6.0]], p_null=0.1)
    log_e = word_log_e_means(S, np.log([0.7, 0.3]), words, where)
    assert np.exp(log_e).mean() < 1.0 + 5.0 * np.exp(log_e).std() / np.sqrt(n)
    for alpha in (0.5, 0.1, 0.01):
        share = np.mean(-log_e <= np.log(alpha))
        assert share <= alpha + 5 * np.sqrt(alpha * (1 - alpha) / n)


@pytest.mark.parametrize(
    ("positions", "held"),
    [
        ([2.0, 7.0, 8.0, 15.0], [2, 7, 8, 15]),
        # Carriers of one shape crowd about a position: each still gets a word of its own.
        ([7.0, 7.1, 7.2, 15.0], [6, 7, 8, 15]),
    ],
)
def test_the_best_of_keys_reaches_what_is_foretold(positions, held) -> None:
    rng = np.random.default_rng(3)
    words = 2 * rng.integers(0, 2, size=(M, 14)) - 1
    where = posterior(positions, p_null=0.1)
    S = words[held][None].astype(float)
    foretold = reachable_log10_p(np.ones((4, 14), dtype=bool), M, 0.0, where)
    found = log10_p_words(S, words, np.zeros(1), where)
    assert found == pytest.approx(foretold, abs=0.4)
    assert reachable_log10_p(np.zeros((4, 14), dtype=bool), M, 0.0, where) == 0.0


@pytest.mark.parametrize("loud", [0.3, 1.0])
@pytest.mark.parametrize("n_chips", [2, 16, 64])
def test_hypotheses_told_apart_in_single_precision_are_the_right_ones(
    monkeypatch, loud, n_chips
) -> None:
    rng = np.random.default_rng(4)
    S = loud * rng.uniform(-1.0, 1.0, size=(60, 5, n_chips))
    # Some that are alike but for the last digits, and one that cannot be beaten.
    S[20:40] = S[20] * (1.0 + 1e-9 * rng.normal(size=(20, 1, 1)))
    words = rng.choice([-1, 1], size=(30, 24, n_chips))
    S[50] = loud * words[0, 3:8]
    where = WordPosterior(rng.uniform(0.0, 23.0, size=(60, 5)), rng.uniform(0.1, 0.9, size=5))
    where.position[7, 2] = np.nan
    prior = np.log(rng.dirichlet(np.ones(60)))
    found = word_log_e_means(S, prior, words, where)
    monkeypatch.setattr(window_mean, "MAX_FLOAT32_CHIPS", 0)
    np.testing.assert_allclose(found, word_log_e_means(S, prior, words, where), rtol=0, atol=1e-10)


def test_bounds_lie_above_the_means_and_near_them() -> None:
    rng = np.random.default_rng(6)
    words = rng.choice([-1, 1], size=(40, 24, 16))
    S = rng.uniform(-1.0, 1.0, size=(60, 5, 16))
    S[50] = words[0, 3:8]
    position = rng.uniform(0.0, 23.0, size=(60, 5))
    position[50] = np.arange(3, 8)
    where = WordPosterior(position, rng.uniform(0.1, 0.9, size=5))
    prior = np.log(rng.dirichlet(np.ones(60)))
    means = word_log_e_means(S, prior, words, where)
    bounds = word_log_e_bounds(S, prior, words, where)
    assert np.all(bounds >= means - 1e-12)
    assert np.all(bounds < means + 3.0)
    assert means[0] > 20.0 > means[1:].max()


def test_most_hypotheses_are_scored_in_single_precision_only(monkeypatch) -> None:
    rng = np.random.default_rng(5)
    S, words = rng.uniform(-1, 1, size=(200, 5, 16)), rng.choice([-1, 1], size=(40, 24, 16))
    where = WordPosterior(rng.uniform(0.0, 23.0, size=(200, 5)), np.full(5, 0.2))
    seen = []
    exact = WordWindows.scores_under

    def counted(self, S, words, hypothesis):
        seen.append(hypothesis.size)
        return exact(self, S, words, hypothesis)

    monkeypatch.setattr(WordWindows, "scores_under", counted)
    word_log_e_means(S, np.full(200, -np.log(200.0)), words, where)
    assert sum(seen) < 0.1 * 200 * 40


def test_frames_say_together_what_most_of_them_say() -> None:
    each = [posterior([2.0, 5.0, np.nan], p_null) for p_null in (0.1, 0.1, 0.4)]
    each[2].position[:] = [[9.0, np.nan, np.nan]]
    found = median_posterior(each)
    np.testing.assert_array_equal(found.position, [[2.0, 5.0, np.nan]])
    np.testing.assert_allclose(found.p_null, [0.2, 0.1, 1.0])
