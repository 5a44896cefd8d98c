"""Chips: right without noise, as good as linear theory under it, silent where nothing is known."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.testing.meshes import icosphere
from meshmark_plugins.schemes.relief.basis import Basis
from meshmark_plugins.schemes.relief.chips import LEAST_NOISE, Heights
from meshmark_plugins.schemes.relief.chips import soft_chips as soft_chips_of_frames

A = 1e-4
V, F = icosphere(3)


@pytest.fixture(scope="module")
def basis() -> Basis:
    return Basis.of(V, F)


def soft_chips(basis, A, r, count):
    """Estimate the chips of one frame."""
    return soft_chips_of_frames(basis, A, [Heights(r, count, 1.0 / np.maximum(count, 1.0), 0.0)])[0]


def word(basis: Basis, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).choice((-1.0, 1.0), basis.n_chips)


def noise(seed: int, sigma: float = 1.0) -> np.ndarray:
    return np.random.default_rng(100 + seed).normal(0.0, sigma, len(V))


def z_score(w, S) -> float:
    """How many standard deviations the word is above random ones."""
    return float(w @ S / np.linalg.norm(S))


def expected_z(basis: Basis, sigma: float) -> float:
    """What the linear estimate of least mean square error gives on average, for noise sigma A.

    With G = (B'B + sigma^2)^-1 B'B, both w.w^ and w^.w^ have the mean trace G.
    """
    B = np.stack([basis.heights(w) for w in np.eye(basis.n_chips)], axis=1)
    H = B.T @ B
    return float(np.sqrt(np.trace(np.linalg.solve(H + sigma**2 * np.eye(len(H)), H))))


def test_without_noise_signs_come_back(basis) -> None:
    w = word(basis)
    S = soft_chips(basis, A, A * basis.heights(w), np.ones(len(V)))
    assert (np.sign(S) == w).mean() > 0.95
    # What is wrong says little.
    wrong = np.sign(S) != w
    assert np.abs(S[wrong]).sum() < 0.02 * np.abs(S).sum()
    # The first estimate is shrunk: what it does not explain of the relief counts as noise.
    assert z_score(w, S) > 0.9 * expected_z(basis, LEAST_NOISE)


@pytest.mark.parametrize("sigma", [0.3, 1.0, 2.0])
def test_noise_costs_what_linear_theory_says(basis, sigma) -> None:
    z = [
        z_score(w, soft_chips(basis, A, A * (basis.heights(w) + noise(k, sigma)), np.ones(len(V))))
        for k in range(6)
        for w in [word(basis, k)]
    ]
    assert np.mean(z) > expected_z(basis, sigma) - 1.0
    assert np.mean(z) < expected_z(basis, sigma) + 1.5


def test_scores_of_other_words_are_those_of_chance(basis) -> None:
    S = soft_chips(basis, A, A * (basis.heights(word(basis)) + noise(0)), np.ones(len(V)))
    others = np.random.default_rng(1).choice((-1.0, 1.0), (4000, basis.n_chips))
    z = others @ S / np.linalg.norm(S)
    assert z.mean() == pytest.approx(0.0, abs=0.06)
    assert z.std() == pytest.approx(1.0, abs=0.05)


def test_scores_are_linear_under_noise(basis) -> None:
    # Cutting the largest would cost what the many small ones say.
    S = soft_chips(basis, A, A * (basis.heights(word(basis)) + noise(3, 3.0)), np.ones(len(V)))
    assert np.abs(S).max() < 1.0
    again = soft_chips(basis, A, -A * (basis.heights(word(basis)) + noise(3, 3.0)), np.ones(len(V)))
    np.testing.assert_allclose(again, -S, atol=1e-9)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_unit_of_length_changes_nothing(basis, unit) -> None:
    r = A * (basis.heights(word(basis)) + noise(4))
    S = soft_chips(basis, A, r, np.ones(len(V)))
    np.testing.assert_allclose(soft_chips(basis, unit * A, unit * r, np.ones(len(V))), S, atol=1e-9)


def test_nothing_known_nothing_said(basis) -> None:
    r = noise(5, A)
    np.testing.assert_array_equal(soft_chips(basis, A, r, np.zeros(len(V))), 0.0)
    np.testing.assert_array_equal(soft_chips(basis, A, np.zeros(len(V)), np.ones(len(V))), 0.0)


def test_what_is_cut_off_says_less_than_what_is_there() -> None:
    P, T = icosphere(4)
    basis = Basis.of(P, T)
    w = np.random.default_rng(0).choice((-1.0, 1.0), basis.n_chips)
    count = (P[:, 2] > 0.0).astype(np.float64)
    S = soft_chips(basis, A, A * basis.heights(w) * count, count)
    # Chips are mixed with their block along the curve; the first level's are told by where it is.
    level = basis.levels[0]
    z = np.bincount(level.label, P[:, 2]) / np.bincount(level.label)
    told = np.abs(S[: level.n_chips])
    assert told[z > 0.3].mean() > 3.0 * told[z < -0.3].mean()
    assert z_score(w, S) > 10.0


def test_a_height_counts_by_how_many_vertices_tell_it(basis) -> None:
    w, rng = word(basis), np.random.default_rng(6)
    # Half of the surface is told by 100 noisy vertices each, half by one.
    count = np.where(V[:, 0] > 0.0, 100.0, 1.0)
    r = A * (basis.heights(w) + rng.normal(size=len(V)) * 3.0 / np.sqrt(count))
    weighted, blunt = (soft_chips(basis, A, r, n) for n in (count, np.ones(len(V))))
    assert z_score(w, weighted) > z_score(w, blunt)
