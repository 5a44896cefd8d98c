from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS

RECORD = {record.name: record for record in RECORDS}["noise"]


class TestNoise(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD


class TestGaussianNoiseSharedByAllFrames(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD

    @pytest.fixture
    def parameters(self):
        return {"kind": "gaussian", "per": "animation"}


def displaced_sphere(seed=3, n=4000, **parameters):
    V, F = sphere(n)
    still = MeshAnimation.from_arrays(5.0 * V + 7.0, F)
    noisy = RECORD.factory(**parameters).apply(still, np.random.default_rng(seed))
    return noisy[0].points - still[0].points


def test_uniform_noise_fills_the_stated_range():
    # On a sphere of radius 5 every vertex is at distance 5 from the centre, so d = 5.
    D = displaced_sphere(amplitude=0.002)
    assert np.abs(D).max() <= 0.01 * (1 + 1e-5)
    assert np.abs(D).max() > 0.0099
    np.testing.assert_allclose(D.std(axis=0), 0.01 / np.sqrt(3), rtol=0.03)


def test_gaussian_noise_has_the_stated_deviation():
    D = displaced_sphere(amplitude=0.002, kind="gaussian")
    np.testing.assert_allclose(D.std(axis=0), 0.01, rtol=0.04)
    assert np.abs(D).max() > 0.03


def test_no_amplitude_no_change():
    np.testing.assert_array_equal(displaced_sphere(amplitude=0.0), 0.0)


def test_frames_get_noise_of_their_own_unless_asked_to_share():
    ball = bending_ball()
    still = ball.select([0])
    twice = MeshAnimation.from_frames([still[0], Frame(2.0, still[0].points, still[0].topology)])
    for per, alike in [("frame", False), ("animation", True)]:
        noisy = RECORD.factory(per=per).apply(twice, np.random.default_rng(0))
        assert np.array_equal(noisy[0].points, noisy[1].points) is alike


def test_polygons_are_kept():
    V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0], [2, 0, 0]])
    topology = Topology(np.array([4, 3]), np.array([0, 1, 2, 3, 1, 4, 2]), 5)
    frames = MeshAnimation.from_frames([Frame(1.0, V, topology)])
    noisy = RECORD.factory().apply(frames, np.random.default_rng(0))
    assert noisy[0].topology is topology


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"amplitude": -0.1}, "amplitude is -0.1, but must be a number in"),
        ({"amplitude": "much"}, "amplitude is 'much'"),
        ({"amplitude": float("nan")}, "amplitude is nan"),
        ({"kind": "pink"}, "kind is 'pink', but must be one of uniform, gaussian"),
        ({"per": "vertex"}, "per is 'vertex'"),
    ],
)
def test_impossible_parameters_are_named(parameters, words):
    with pytest.raises(UsageError, match=words):
        RECORD.factory(**parameters)


def test_text_from_a_command_line_is_understood():
    assert RECORD.factory(amplitude="0.002") == RECORD.factory(amplitude=0.002)
