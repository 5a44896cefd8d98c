from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import InputError, UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark_plugins.attacks import RECORDS

RECORD = {record.name: record for record in RECORDS}["cropping"]


class TestCropping(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD


class TestCroppingEachFrame(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD

    @pytest.fixture
    def parameters(self):
        return {"per": "frame", "share": 0.3}


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
def test_a_sphere_loses_a_cap_of_the_stated_share(share):
    # Archimedes: the area, and with it the evenly spread vertices, is linear in height.
    V, F = sphere(2000)
    still = MeshAnimation.from_arrays(V, F)
    cropped = RECORD.factory(share=share, direction=(0, 0, 1)).apply(
        still, np.random.default_rng(0)
    )[0]
    assert cropped.points[:, 2].max() == pytest.approx(1 - 2 * share, abs=2e-3)
    lost = 1 - len(cropped.points) / len(V)
    assert share - 1e-9 <= lost <= share + 0.005


def test_all_frames_lose_the_same_vertices_per_animation():
    ball = bending_ball()
    cropped = RECORD.factory(share=0.3).apply(ball, np.random.default_rng(5))
    assert cropped.constant_topology
    # Each kept point of the first frame is some vertex j; all frames hold that same j.
    j = [int(np.flatnonzero((ball[0].points == p).all(axis=1))[0]) for p in cropped[0].points]
    for before, after in zip(ball, cropped, strict=True):
        np.testing.assert_array_equal(after.points, before.points[j])


def test_frames_are_cut_by_planes_of_their_own_per_frame():
    ball = bending_ball()
    cropped = RECORD.factory(share=0.3, per="frame").apply(ball, np.random.default_rng(5))
    assert not cropped.constant_topology
    assert not cropped[0].topology.same_as(cropped[1].topology)


def test_kept_polygons_are_those_with_all_corners_kept():
    V = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0.0]])
    topology = Topology(np.array([4, 3]), np.array([0, 1, 2, 3, 1, 4, 2]), 5)
    frames = MeshAnimation.from_frames([Frame(1.0, V, topology)])
    cropped = RECORD.factory(share=0.2, direction="1,0,0").apply(frames, np.random.default_rng(0))
    assert cropped[0].topology.counts.tolist() == [4]
    np.testing.assert_array_equal(cropped[0].points, V[:4])


def test_nothing_left_is_said_with_file_prim_and_frame():
    for per in ("frame", "animation"):
        with pytest.raises(InputError, match=r"ball.usda: /Ball: frame 1: .*leaves no face"):
            RECORD.factory(share=0.999, per=per).apply(bending_ball(), np.random.default_rng(0))[0]


def test_a_varying_connectivity_cannot_be_cut_once():
    varying = RECORD.factory(per="frame").apply(bending_ball(), np.random.default_rng(0))
    with pytest.raises(UsageError, match="one connectivity"):
        RECORD.factory(per="animation").apply(varying, np.random.default_rng(0))


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"share": 1.0}, r"share is 1.0, but must be a number in \[0, 1\)"),
        ({"direction": "up"}, "direction is 'up', but must be three numbers"),
        ({"direction": (0, 0, 0)}, "direction's length is 0"),
        ({"per": "vertex"}, "per is 'vertex'"),
    ],
)
def test_impossible_parameters_are_named(parameters, words):
    with pytest.raises(UsageError, match=words):
        RECORD.factory(**parameters)
