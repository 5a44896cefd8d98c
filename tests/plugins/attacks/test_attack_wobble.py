from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS

RECORD = {record.name: record for record in RECORDS}["wobble"]


class TestWobble(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD


class TestWobbleOfEachFrame(TestWobble):
    @pytest.fixture
    def parameters(self):
        return {"per": "frame"}


def displacement(**parameters):
    """Displace a sphere of radius 5, where d is 5."""
    V, F = sphere(4000)
    still = MeshAnimation.from_arrays(5.0 * V + 7.0, F)
    attack = RECORD.factory(**parameters)
    return attack.apply(still, np.random.default_rng(0))[0].points - still[0].points


def test_one_wave_is_as_large_as_asked_for_and_displaces_along_a_line():
    D = displacement(waves=1, amplitude=0.02)
    assert np.linalg.norm(D, axis=1).max() == pytest.approx(0.1, rel=1e-3)
    assert np.linalg.matrix_rank(D, tol=1e-9) == 1


@pytest.mark.parametrize("waves", [2, 3, 10])
def test_all_waves_together_stay_within_the_amplitude(waves):
    D = displacement(waves=waves, amplitude=0.02)
    assert 0.01 < np.linalg.norm(D, axis=1).max() <= 0.1 * (1 + 1e-9)


@pytest.mark.parametrize(("waves", "wavelength"), [(1, 2.0), (1, 0.7), (4, 3.0)])
def test_waves_have_the_length_asked_for(waves, wavelength):
    # Sums of plane waves of length l solve Helmholtz' equation: Laplacian s = -(2 pi / l)^2 s.
    rng = np.random.default_rng(0)
    places, h = rng.normal(size=(200, 3)), 1e-3
    steps = h * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
    V = (places + steps[:, None]).reshape(-1, 3)
    still = MeshAnimation.from_arrays(V, np.array([[0, 1, 2]]))
    after = RECORD.factory(waves=waves, wavelength=wavelength).apply(still, rng)[0]
    s, *around = (after.points - V).reshape(7, -1, 3)
    laplacian = (np.sum(around, axis=0) - 6.0 * s) / h**2
    d = np.linalg.norm(V - V.mean(axis=0), axis=1).mean()
    expected = -((2.0 * np.pi / (wavelength * d)) ** 2) * s
    np.testing.assert_allclose(laplacian, expected, atol=1e-4 * np.abs(expected).max())


def test_frames_share_waves_unless_asked_not_to():
    ball = bending_ball().select([0])[0]
    twice = MeshAnimation.from_arrays(np.array([ball.points, ball.points + 4.0]), ball.faces)
    for per, alike in (("animation", True), ("frame", False)):
        after = RECORD.factory(per=per).apply(twice, np.random.default_rng(0))
        moves = [two.points - one.points for one, two in zip(twice, after, strict=True)]
        assert np.allclose(moves[0], moves[1], atol=1e-9) is alike


def test_it_is_smooth():
    V, F = sphere(4000)
    D = displacement()
    side = np.linalg.norm(V[F[:, 0]] - V[F[:, 1]], axis=1)
    bend = np.linalg.norm(D[F[:, 0]] - D[F[:, 1]], axis=1)
    # The slope of a sine of length 2 d: pi times the amplitude a d.
    assert np.all(bend <= np.pi * 0.01 * 5.0 * side * (1 + 1e-6))
