from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS

BY_NAME = {record.name: record for record in RECORDS}


class TestSmoothing(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["smoothing"]


class TestTaubinSmoothing(TestSmoothing):
    @pytest.fixture
    def parameters(self):
        return {"kind": "taubin", "strength": 0.5}


def smoothed(animation, **parameters):
    return BY_NAME["smoothing"].factory(**parameters).apply(animation, np.random.default_rng(0))


def octahedron():
    V = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    upper = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4]]
    lower = [[2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    return V, np.array(upper + lower)


def radius(frame):
    return np.linalg.norm(frame.points - frame.points.mean(axis=0), axis=1)


def test_an_octahedron_shrinks_by_a_tenth_a_step():
    # The four neighbours of each corner average to the centre, so V becomes 0.9 V each time.
    still = MeshAnimation.from_arrays(*octahedron())
    for n in (0, 1, 5):
        np.testing.assert_allclose(
            smoothed(still, iterations=n)[0].points, 0.9**n * still[0].points, atol=1e-12
        )


def test_taubin_steps_back():
    # One step out at lambda, one back at mu = 1 / (0.1 - 1 / lambda).
    still = MeshAnimation.from_arrays(*octahedron())
    factor = (1 - 0.5) * (1 + 1 / 1.9)
    for n in (1, 3):
        points = smoothed(still, iterations=n, kind="taubin", strength=0.5)[0].points
        np.testing.assert_allclose(points, factor**n * still[0].points, atol=1e-12)


def test_taubin_keeps_a_sphere_where_the_umbrella_shrinks_it():
    still = MeshAnimation.from_arrays(*sphere(2000))
    umbrella = smoothed(still, iterations=50, strength=0.5)[0]
    taubin = smoothed(still, iterations=50, strength=0.5, kind="taubin")[0]
    assert radius(umbrella).mean() < 0.95
    assert radius(taubin).mean() == pytest.approx(1.0, abs=0.01)


def test_noise_goes():
    V, F = sphere(2000)
    noisy = MeshAnimation.from_arrays(V + np.random.default_rng(0).normal(0, 0.01, V.shape), F)
    before, after = radius(noisy[0]).std(), radius(smoothed(noisy, iterations=50)[0]).std()
    assert after < 0.3 * before


def test_a_border_stays_and_a_flat_inside_relaxes():
    # A square fan: four corners on the border, the hub off its centre.
    V = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [1.5, 1, 1]])
    F = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    points = smoothed(MeshAnimation.from_arrays(V, F), iterations=1)[0].points
    np.testing.assert_array_equal(points[:4], V[:4])
    np.testing.assert_allclose(points[4], [1.45, 1, 0.9])


def test_neighbours_are_those_along_polygon_edges():
    # A cube of quads: each corner's neighbours are three, none across a diagonal.
    V = np.array([[x, y, z] for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    topology = Topology(np.full(6, 4), np.array(quads).ravel(), 8)
    cube = MeshAnimation.from_frames([Frame(1.0, V, topology)])
    # The mean of the neighbours of a corner is a third of it.
    factor = 0.9 + 0.1 / 3
    np.testing.assert_allclose(smoothed(cube, iterations=1)[0].points, factor * V)


def test_vertices_without_a_face_stay():
    V, F = octahedron()
    V = np.concatenate([V, [[5.0, 5, 5]]])
    points = smoothed(MeshAnimation.from_arrays(V, F), iterations=3)[0].points
    np.testing.assert_array_equal(points[6], [5, 5, 5])


def test_frames_are_smoothed_each_by_itself():
    ball = bending_ball()
    for index, frame in enumerate(smoothed(ball, iterations=3)):
        alone = smoothed(ball.select([index]), iterations=3)[0]
        np.testing.assert_array_equal(frame.points, alone.points)
