from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, norm

from meshmark.statistics.p_values import (
    NORMAL_SHARE,
    exact_log10_p,
    log10_p_words,
    log_cosh,
    normal_log_p,
    reachable_log10_p,
    word_log_e,
    word_log_e_means,
)


def all_words(K: int) -> np.ndarray:
    return np.array(list(itertools.product([-1, 1], repeat=K)))


def test_log_cosh() -> None:
    x = np.linspace(-5, 5, 101)
    np.testing.assert_allclose(log_cosh(x), np.log(np.cosh(x)), atol=1e-14)
    assert log_cosh(np.array([1e6]))[0] == pytest.approx(1e6 - np.log(2))


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=8))
def test_every_e_value_has_expectation_one(S) -> None:
    words = all_words(len(S))
    e = np.exp(word_log_e(np.array([S]), words[:, None, :]))
    np.testing.assert_allclose(e.mean(axis=0), 1.0, rtol=1e-9)


def test_hypotheses_and_lost_carriers_have_expectation_at_most_one() -> None:
    # All 2^(2 x 3) pairs of words on two carriers of three chips, under two hypotheses.
    S = np.random.default_rng(0).uniform(-1, 1, size=(2, 2, 3))
    pairs = np.array(list(itertools.product(all_words(3), repeat=2)))
    e = np.exp(word_log_e_means(S, np.log([0.7, 0.3]), pairs))
    # Only the largest terms, pairs of hypothesis and tilt, are summed up: less than 1, not more.
    assert 0.5 < e.mean() <= 1.0 + 1e-12


@given(st.integers(1, 12), st.integers(0, 12))
def test_exact_tail_of_equal_chips_is_binomial(K, right) -> None:
    right = min(right, K)
    word = np.array([1] * right + [-1] * (K - right))
    expected = binom.sf(right - 1, K, 0.5)
    assert 10 ** exact_log10_p(np.ones(K), word) == pytest.approx(expected)


@settings(max_examples=30)
@given(st.lists(st.floats(-1, 1), min_size=1, max_size=10).filter(np.linalg.norm))
def test_exact_tail_is_never_above_hoeffding(S) -> None:
    S, words = np.array(S), all_words(len(S))
    scored = words[(words @ S) > 0]
    hoeffding = -((scored @ S) ** 2) / (2.0 * (S**2).sum()) / np.log(10.0)
    assert np.all(exact_log10_p(S, scored) <= hoeffding + 1e-9)


@settings(max_examples=30)
@given(st.lists(st.floats(-1, 1), min_size=1, max_size=10).filter(np.linalg.norm))
def test_the_normal_bound_is_never_below_the_exact_tail(S) -> None:
    S, words = np.array(S), all_words(len(S))
    bound = normal_log_p(S[None], words)[:, 0] / np.log(10.0)
    assert np.all(bound >= exact_log10_p(S, words) - 1e-6)


def test_two_equal_chips_reach_the_normal_bound() -> None:
    # Both agree in one case of four, which is c P(N >= sqrt 2): no smaller c would do.
    assert np.exp(normal_log_p(np.ones((1, 2)), np.ones(2))) == pytest.approx(0.25)


def test_weak_chips_of_one_word_are_told_by_the_normal_bound() -> None:
    rng = np.random.default_rng(4)
    word = rng.choice([-1, 1], 2000)
    S = 0.2 * (rng.normal(size=2000) + 0.13 * word)
    hypotheses = np.stack([S, np.zeros_like(S)])[:, None, :]
    z = word @ S / np.linalg.norm(S)
    exact = np.log10(norm.sf(z))
    found = log10_p_words(hypotheses, word[None], np.log([0.5, 0.5]))
    # Twice for two hypotheses, 3.178 for the bound, and the share of the rate.
    assert found == pytest.approx(exact + np.log10(2.0 * 3.178 / NORMAL_SHARE), abs=1e-3)


@pytest.mark.parametrize("n_words", [1, 8])
@pytest.mark.parametrize("K", [16, 40])
def test_p_is_honest_on_random_keys(n_words, K) -> None:
    rng = np.random.default_rng(11)
    S = np.clip(rng.normal(size=(6, K)), -1, 1)
    n = 2000
    words = 2 * rng.integers(0, 2, size=(n, n_words, K)) - 1
    hypotheses = np.stack([S, 0.5 * np.roll(S, 1, axis=1)])
    log10_p = log10_p_words(hypotheses, words, np.log([0.8, 0.2]))
    assert np.all(log10_p <= 0)
    for alpha in (0.5, 0.1, 0.01):
        share = np.mean(log10_p <= np.log10(alpha))
        assert share <= alpha + 5 * np.sqrt(alpha * (1 - alpha) / n)


def test_right_words_in_any_order_are_found() -> None:
    rng = np.random.default_rng(5)
    words = 2 * rng.integers(0, 2, size=(8, 16)) - 1
    perfect = -96 * np.log10(2)
    in_order = log10_p_words(words[:6].astype(float), words)
    assert perfect < in_order < perfect + 3
    assert in_order == pytest.approx(reachable_log10_p(np.ones((6, 16), dtype=bool), 8), abs=0.05)
    swapped = log10_p_words(words[[1, 0, 2, 3, 5, 4]].astype(float), words)
    scrambled = log10_p_words(words[[3, 2, 7, 5, 4, 0]].astype(float), words)
    # The farther from the order words were given out in, the dearer; 20160 is all there are.
    assert in_order < swapped < scrambled < in_order + np.log10(20160) + 1


def test_lost_carriers_leave_the_order_of_the_others() -> None:
    words = 2 * np.random.default_rng(9).integers(0, 2, size=(8, 16)) - 1
    kept = log10_p_words(words[[0, 2, 3, 5]].astype(float), words)
    jumbled = log10_p_words(words[[3, 5, 0, 2]].astype(float), words)
    assert kept < jumbled - 0.5


def test_one_hypothesis_of_many_is_paid_for_by_its_prior() -> None:
    rng = np.random.default_rng(12)
    words = 2 * rng.integers(0, 2, size=(4, 16)) - 1
    right = words[:3].astype(float)
    alone = log10_p_words(right, words)
    for prior in (0.5, 0.01):
        S = np.stack([np.zeros_like(right), right])
        read = log10_p_words(S, words, np.log([1.0 - prior, prior]))
        assert read == pytest.approx(alone - np.log10(prior), abs=1e-6)


def test_more_parts_than_words() -> None:
    words = 2 * np.random.default_rng(6).integers(0, 2, size=(3, 16)) - 1
    S = words[[0, 1, 2, 0, 1]].astype(float)
    assert log10_p_words(S, words) < -48 * np.log10(2) + 2
    assert log10_p_words(S[::-1], words) < -48 * np.log10(2) + 4


def test_lost_parts_cost_little() -> None:
    rng = np.random.default_rng(8)
    words = 2 * rng.integers(0, 2, size=(8, 16)) - 1
    whole = words[:6].astype(float)
    lost = whole.copy()
    lost[2:] = rng.uniform(-1, 1, size=(4, 16))
    # Two perfect parts of sixteen bits prove 9.6 decades, before 1.7 for finding their words.
    assert log10_p_words(lost, words) < -6
    assert log10_p_words(whole, words) < -26


def test_sixteen_shared_bits_never_reach_one_in_a_million() -> None:
    word = 2 * np.random.default_rng(1).integers(0, 2, size=16) - 1
    S = np.tile(word, (6, 1)).astype(float)
    assert log10_p_words(S, word[None]) == pytest.approx(-16 * np.log10(2))
    assert reachable_log10_p(np.ones((6, 16), dtype=bool), 1) == pytest.approx(-16 * np.log10(2))
    assert reachable_log10_p(np.ones((6, 16), dtype=bool), 8) < -20


def test_no_evidence_is_no_evidence() -> None:
    words = np.ones((8, 16), dtype=int)
    assert log10_p_words(np.zeros((6, 16)), words) == 0.0
    assert log10_p_words(np.zeros((6, 16)), words[:1]) == 0.0
    assert reachable_log10_p(np.zeros((6, 16), dtype=bool), 8) == 0.0
