"""E-values among decoys: their mean is 1, whatever the fit, over all secrets and decoys."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.statistics.decoys import BET, log_e_among_decoys

# Of a secret: its parts, and the values that each may have.
PARTS, VALUES = 2, 3


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2]), st.floats(0.1, 30.0))
def test_the_mean_over_all_secrets_and_decoys_is_one(seed, n_decoys, sharpness) -> None:
    """The second part's fit depends on the secret's first part, as it may."""
    rng = np.random.default_rng(seed)
    first = sharpness * rng.normal(size=VALUES)
    second = sharpness * rng.normal(size=(VALUES, VALUES))
    every = np.array(list(itertools.product(range(VALUES), repeat=PARTS * (1 + n_decoys))))
    one, two = every[:, : 1 + n_decoys], every[:, 1 + n_decoys :]
    log_fit = np.array([first[one], second[one[:, :1], two]])
    assert np.exp(log_e_among_decoys(log_fit)).mean() == pytest.approx(1.0, rel=1e-9)


def test_a_fit_that_knows_what_comes_later_is_no_e_value() -> None:
    """What the enumeration would show of a fit that breaks the rule."""
    every = np.array(list(itertools.product(range(VALUES), repeat=PARTS * 2)))
    one, two = every[:, :2], every[:, 2:]
    knowing = np.where(one == two[:, :1], 3.0, -3.0)
    log_fit = np.array([knowing, np.where(two == one[:, :1], 3.0, -3.0)])
    assert np.exp(log_e_among_decoys(log_fit)).mean() > 1.1


def test_what_fits_far_better_wins_all_and_what_fits_far_worse_loses_the_bet_only() -> None:
    M, B = 31, 5
    log_fit = np.zeros((B, 2, 1 + M))
    log_fit[:, 0, 0], log_fit[:, 1, 0] = 1000.0, -1000.0
    won, lost = log_e_among_decoys(log_fit)
    assert won == pytest.approx(B * np.log(1.0 - BET + BET * (1 + M)))
    assert lost == pytest.approx(B * np.log(1.0 - BET))


def test_what_tells_nothing_is_one() -> None:
    assert log_e_among_decoys(np.full((3, 4, 8), -7.0)) == pytest.approx(np.zeros(4), abs=1e-12)
