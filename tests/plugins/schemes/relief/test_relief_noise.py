"""Smooth noise: its precision undoes its covariance, and chips stand out of it."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.testing.meshes import icosphere, plane
from meshmark_plugins.schemes.relief.basis import Basis, Smoother
from meshmark_plugins.schemes.relief.chips import Heights, soft_chips, soft_chips_in
from meshmark_plugins.schemes.relief.noise import ROUGH, SmoothNoise

A = 1e-4
V, F = icosphere(3)


@pytest.fixture(scope="module")
def basis() -> Basis:
    return Basis.of(V, F)


def covariance(smoother: Smoother) -> np.ndarray:
    """Return b S M^-1 S' + a M^-1, dense, with the smoother S; 1 and ROUGH in the mean."""
    M = smoother.mass
    S = smoother(np.eye(len(M)))
    smooth = (S / M) @ S.T
    return smooth / np.average(np.diag(smooth), weights=M) + ROUGH * M.mean() * np.diag(1.0 / M)


@pytest.mark.parametrize("mesh", [icosphere(3), plane(20)])
def test_precision_undoes_covariance(mesh) -> None:
    smoother = Smoother(*mesh, 0.2)
    noise = SmoothNoise(smoother)
    # The mean variance of the smooth part is found out by random fields, so not exactly.
    found = noise.precision(covariance(smoother))
    assert np.linalg.norm(found - np.eye(len(found))) < 0.1 * np.sqrt(len(found))
    x = np.random.default_rng(0).normal(size=(len(smoother.mass), 2))
    P = noise.precision(np.eye(len(x)))
    np.testing.assert_allclose(P, P.T, atol=1e-9 * np.abs(P).max())
    np.testing.assert_allclose(noise.precision(x), P @ x, rtol=1e-9, atol=1e-9)
    assert np.linalg.eigvalsh(P).min() > 0.0


def heights(values: list[np.ndarray]) -> list[Heights]:
    one = np.ones(len(V))
    return [Heights(A * r, one, one, 0.0) for r in values]


def z_score(w, S) -> float:
    """How many standard deviations the word is above random ones."""
    return float(w @ S / np.linalg.norm(S))


def expected_z(basis: Basis, C: np.ndarray) -> float:
    """What the linear estimate of least mean square error gives on average, for covariance C A^2.

    With G = (B' C^-1 B + 1)^-1 B' C^-1 B, both w.w^ and w^.w^ have the mean trace G.
    """
    B = basis.heights(np.eye(basis.n_chips))
    H = B.T @ np.linalg.solve(C, B)
    return float(np.sqrt(np.trace(np.linalg.solve(H + np.eye(len(H)), H))))


def test_chips_stand_out_of_smooth_noise_as_theory_says(basis) -> None:
    smoother = basis.levels[0].smoother
    C = 9.0 * covariance(smoother)
    root, noise = np.linalg.cholesky(C), SmoothNoise(smoother)
    scores, plain = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        w = rng.choice((-1.0, 1.0), basis.n_chips)
        # The same in all frames: more frames do not help.
        frames = heights([basis.heights(w) + root @ rng.normal(size=len(V))] * 3)
        scores.append(z_score(w, soft_chips_in(noise, basis, A, frames).mean(axis=0)))
        plain.append(z_score(w, soft_chips(basis, A, frames).mean(axis=0)))
    assert np.mean(scores) == pytest.approx(expected_z(basis, C), abs=0.7)
    assert np.mean(scores) > np.mean(plain) + 1.0


def test_frames_add_up_and_unknown_heights_add_nothing(basis) -> None:
    w = np.random.default_rng(0).choice((-1.0, 1.0), basis.n_chips)
    noise, frames = SmoothNoise(basis.levels[0].smoother), heights([basis.heights(w)])
    alone = soft_chips_in(noise, basis, A, frames)[0]
    nothing = Heights.of_nothing(len(V))
    both = soft_chips_in(noise, basis, A, [*frames, nothing])
    np.testing.assert_array_equal(both[1], 0.0)
    assert both[0] @ alone / np.linalg.norm(both[0]) / np.linalg.norm(alone) > 0.99
    np.testing.assert_array_equal(soft_chips_in(noise, basis, A, [nothing, nothing]), 0.0)


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_unit_of_length_changes_nothing(basis, unit) -> None:
    rng = np.random.default_rng(1)
    w = rng.choice((-1.0, 1.0), basis.n_chips)
    r = basis.heights(w) + rng.normal(size=len(V))
    one = np.ones(len(V))
    noise, scaled = SmoothNoise(basis.levels[0].smoother), [Heights(unit * A * r, one, one, 0.0)]
    np.testing.assert_allclose(
        soft_chips_in(noise, basis, unit * A, scaled),
        soft_chips_in(noise, basis, A, heights([r])),
        atol=1e-9,
    )
