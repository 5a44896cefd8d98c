from __future__ import annotations

import itertools

import numpy as np
import pytest

from meshmark.statistics.assignments import (
    FALSE_CARRIER_WEIGHT,
    ORDER_DECAYS,
    mean_over_assignments,
)
from meshmark.statistics.p_values import word_log_e


def injections(C: int, G: int) -> list[tuple[int | None, ...]]:
    """List all ways to give as many of G words as possible to C carriers, None for no word."""
    choices = itertools.product([None, *range(G)], repeat=C)
    return [
        choice
        for choice in choices
        if len({m for m in choice if m is not None}) == min(C, G) == C - choice.count(None)
    ]


def ordered(C: int, G: int) -> list[tuple[int | None, ...]]:
    """List all ways to give any number of G words to C carriers in their order."""
    choices = itertools.product([None, *range(G)], repeat=C)
    given = [[m for m in choice if m is not None] for choice in choices]
    choices = itertools.product([None, *range(G)], repeat=C)
    return [c for c, words in zip(choices, given, strict=True) if words == sorted(set(words))]


def brute_mean(log_e: np.ndarray) -> float:
    C, M = log_e.shape
    prior = 0.5 ** np.abs(np.arange(1, M + 1) - min(C, M))
    prior /= prior.sum()
    means = []
    for k in ORDER_DECAYS:
        total = 0.0
        for G in range(1, M + 1):
            terms, weights = [], []
            for choice in injections(C, G):
                pairs = [(c, m) for c, m in enumerate(choice) if m is not None]
                weights.append(np.exp(-k * sum(abs(c - m) for c, m in pairs)))
                terms.append(weights[-1] * np.exp(sum(log_e[c, m] for c, m in pairs)))
            total += prior[G - 1] * sum(terms) / sum(weights)
        means.append(total)
    total = 0.0
    for G in range(1, M + 1):
        terms, weights = [], []
        for choice in ordered(C, G):
            pairs = [(c, m) for c, m in enumerate(choice) if m is not None]
            weights.append(FALSE_CARRIER_WEIGHT ** (C - len(pairs)))
            terms.append(weights[-1] * np.exp(sum(log_e[c, m] for c, m in pairs)))
        total += prior[G - 1] * sum(terms) / sum(weights)
    means.append(total)
    return float(np.log(np.mean(means)))


@pytest.mark.parametrize(("C", "M"), [(1, 1), (2, 2), (2, 4), (3, 2), (4, 4), (5, 3)])
def test_the_mean_is_that_of_all_assignments(C, M) -> None:
    log_e = np.random.default_rng(3).normal(size=(C, M))
    assert mean_over_assignments(log_e) == pytest.approx(brute_mean(log_e))


def test_leading_axes_are_independent() -> None:
    log_e = np.random.default_rng(4).normal(size=(2, 3, 4, 3))
    each = [[mean_over_assignments(item) for item in row] for row in log_e]
    np.testing.assert_allclose(mean_over_assignments(log_e), each, rtol=1e-12)


def test_the_mean_has_expectation_one() -> None:
    # All 2^(2 x 3) pairs of words on three carriers of three chips, two of which hold a word.
    S = np.random.default_rng(0).uniform(-1, 1, size=(3, 3))
    words = np.array(list(itertools.product([-1, 1], repeat=3)))
    pairs = np.array(list(itertools.product(words, repeat=2)))
    log_e = mean_over_assignments(word_log_e(S, pairs))
    np.testing.assert_allclose(np.exp(log_e).mean(axis=0), 1.0, rtol=1e-9)


def test_huge_e_values_do_not_overflow() -> None:
    log_e = np.full((4, 4), -5.0)
    np.fill_diagonal(log_e, 400.0)
    # All four in order, at the price of the belief in that.
    assert 1600.0 - 8.0 < mean_over_assignments(log_e) < 1600.0
