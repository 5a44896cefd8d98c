"""One key on several groups of carriers: an e-value, whatever their evidence has to do with it."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.special import logsumexp

from meshmark.statistics.joint_mean import Group, joint_log_e
from meshmark.statistics.p_values import word_log_e_means
from meshmark.statistics.word_windows import WordPosterior


def group(S: np.ndarray, positions: list[float]) -> Group:
    """Measure carriers under two hypotheses."""
    posterior = WordPosterior(np.tile(np.array(positions), (2, 1)), np.full(len(positions), 0.2))
    return Group(np.stack([S, 0.3 * S]), np.log([0.8, 0.2]), posterior)


@pytest.mark.parametrize("K", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_over_all_keys_the_mean_is_at_most_one(K: int) -> None:
    """Exactly, over every list of 8 words there is: groups say the very same, or something else."""
    signs = np.array(list(product((-1, 1), repeat=8 * K)), dtype=np.int8)
    one, two = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 2, K))
    for groups in (
        [group(one, [2.0, 5.0]), group(one, [2.0, 5.0]), group(one, [2.3, 4.0])],
        [group(one, [2.0, 5.0]), group(two, [2.0, 3.0])],
        [group(one, [2.0, 5.0]), group(-one, [2.0, 5.0])],
    ):
        log_e = joint_log_e(groups, signs.reshape(-1, 8, K))
        mean = float(np.exp(logsumexp(log_e) - np.log(len(log_e))))
        # Small terms are left out.
        assert 0.2 < mean <= 1.0 + 1e-9


def test_groups_of_other_words_are_independent() -> None:
    """What fits on both is nearly the product; where one says nothing, the other is left."""
    words = np.random.default_rng(1).choice(np.array([-1, 1], np.int8), (1, 64, 16))
    near = group(0.8 * words[0, [5, 12]], [5.0, 12.0])
    far = group(0.8 * words[0, [40, 50]], [40.0, 50.0])
    nothing = group(-0.8 * words[0, [40, 50]], [40.0, 50.0])

    def alone(each: Group) -> float:
        return float(word_log_e_means(each.S, each.log_prior, words, each.posterior)[0])

    [both] = joint_log_e([near, far], words)
    assert alone(near) + alone(far) - 5.0 < both < alone(near) + alone(far)
    [rest] = joint_log_e([near, nothing], words)
    # One of two is left: a third, and a half for which.
    assert alone(near) - np.log(6.0) - 2.0 < rest < alone(near)
