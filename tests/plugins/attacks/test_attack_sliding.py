"""Relaxation and jitter: vertices that move along a surface, which stays."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.metrics import surface_distance
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark.testing.meshes import plane
from meshmark_plugins.attacks import RECORDS

BY_NAME = {record.name: record for record in RECORDS}


class TestRelaxation(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["relaxation"]


class TestJitter(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["jitter"]


class TestJitterOfEachFrame(TestJitter):
    @pytest.fixture
    def parameters(self):
        return {"per": "frame"}


def attacked(name, animation, seed=0, **parameters):
    return BY_NAME[name].factory(**parameters).apply(animation, np.random.default_rng(seed))


def tilted(V):
    """Turn the xy-plane into one that no axis lies in."""
    return V @ np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0] + 2.0


def uneven_plane():
    V, F = plane(21)
    inner = (np.abs(V[:, :2] - 0.5) < 0.5 - 1e-9).all(axis=1)
    V[inner, :2] += np.random.default_rng(0).uniform(-0.015, 0.015, (inner.sum(), 2))
    return V, F, inner


def test_on_a_plane_a_step_of_relaxation_is_an_umbrella_step():
    V, F, inner = uneven_plane()
    still = MeshAnimation.from_arrays(tilted(V), F)
    for strength in (0.3, 1.0):
        slid = attacked("relaxation", still, steps=2, strength=strength)[0].points
        umbrella = attacked("smoothing", still, iterations=2, strength=strength)[0].points
        np.testing.assert_allclose(slid, umbrella, atol=1e-9)
    np.testing.assert_allclose(slid[~inner], still[0].points[~inner], atol=1e-12)


@pytest.mark.parametrize("name", ["relaxation", "jitter"])
def test_vertices_stay_on_the_surface_and_it_stays(name):
    V, F = sphere(2000)
    rng = np.random.default_rng(0)
    V += rng.normal(0, 0.005, V.shape)
    still = MeshAnimation.from_arrays(V, F)
    after = attacked(name, still)[0]
    moved = np.linalg.norm(after.points - V, axis=1)
    assert np.median(moved) > 1e-3
    away = surface_distance(V, F, after.points, F)
    assert away.mrms < 0.1 * np.sqrt(np.mean(moved**2))


def test_relaxation_evens_out_the_density():
    V, F, _ = uneven_plane()
    edge = np.linalg.norm(V[F[:, 0]] - V[F[:, 1]], axis=1)
    after = attacked("relaxation", MeshAnimation.from_arrays(V, F), steps=20)[0].points
    # The grid's own sides, of one length, are what it goes back to.
    assert np.std(after[:, 0] - plane(21)[0][:, 0]) < 0.2 * np.std(V[:, 0] - plane(21)[0][:, 0])
    assert np.linalg.norm(after[F[:, 0]] - after[F[:, 1]], axis=1).std() < edge.std()


def test_jitter_fills_the_disc_it_is_drawn_from():
    V, F = plane(81)
    still = MeshAnimation.from_arrays(tilted(V), F)
    # Three sides of an inner cell of the grid: two of length 1 / 80, a diagonal.
    sides = np.linalg.norm(still[0].points[F] - still[0].points[np.roll(F, 1, axis=1)], axis=2)
    mean = (sides[:, :2].sum() + sides[:, 2].sum()) / sides.size
    inside = (np.abs(V[:, :2] - 0.5) < 0.45).all(axis=1)
    moved = attacked("jitter", still, size=0.5)[0].points - still[0].points
    r = np.linalg.norm(moved[inside], axis=1) / (0.5 * mean)
    assert 0.97 < r.max() < 1.03
    # Evenly over a disc: half of them within 1 / sqrt 2 of the radius.
    assert np.mean(r < np.sqrt(0.5)) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize("name", ["relaxation", "jitter"])
def test_points_off_the_surface_stay_and_polygons_too(name):
    V = np.concatenate([plane(9)[0], [[0.5, 0.5, 3.0]]])
    topology = Topology(np.array([4, 3]), np.array([0, 1, 10, 9, 10, 11, 20]), len(V))
    after = attacked(name, MeshAnimation.from_frames([Frame(1.0, V, topology)]))[0]
    assert after.topology is topology
    np.testing.assert_array_equal(after.points[-1], V[-1])


def test_jitter_of_the_animation_rests_on_the_moving_surface():
    ball = bending_ball()
    for per, resting in (("animation", True), ("frame", False)):
        after = attacked("jitter", ball, per=per)
        moves = [two.points - one.points for one, two in zip(ball, after, strict=True)]
        change = np.sqrt(np.mean((moves[1] - moves[0]) ** 2) / np.mean(moves[0] ** 2))
        assert bool(change < 0.3) is resting


def test_nothing_to_do_changes_nothing():
    ball = bending_ball()
    for name, nothing in (("relaxation", {"steps": 0}), ("jitter", {"size": 0, "per": "frame"})):
        np.testing.assert_array_equal(attacked(name, ball, **nothing)[1].points, ball[1].points)
