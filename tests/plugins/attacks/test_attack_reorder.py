from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.metrics import surface_distance
from meshmark.testing.attacks import AttackSuite, bending_ball
from meshmark_plugins.attacks import RECORDS

BY_NAME = {record.name: record for record in RECORDS}


class TestReorder(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["reorder"]


class TestReorderOfEachFrame(TestReorder):
    @pytest.fixture
    def parameters(self):
        return {"per": "frame"}


def shuffled(animation, **parameters):
    return BY_NAME["reorder"].factory(**parameters).apply(animation, np.random.default_rng(0))


def polygons(frame):
    """Name each polygon by the places of its corners, whatever their numbers."""
    corners = frame.points[frame.topology.indices].round(12)
    pieces = np.split(corners, np.cumsum(frame.topology.counts)[:-1])
    return sorted(tuple(map(tuple, piece)) for piece in pieces)


@pytest.mark.parametrize("per", ["frame", "animation"])
def test_geometry_is_kept_and_order_is_not(per):
    ball = bending_ball()
    for before, after in zip(ball, shuffled(ball, per=per), strict=True):
        assert polygons(after) == polygons(before)
        assert not np.array_equal(after.points, before.points)
        assert np.mean(np.diff(after.faces[:, 0]) == np.diff(before.faces[:, 0])) < 0.1
        found = surface_distance(before.points, before.faces, after.points, after.faces)
        assert found.hausdorff < 1e-7


def test_one_order_for_all_frames_keeps_trajectories():
    ball = bending_ball()
    after = shuffled(ball)
    j = [int(np.flatnonzero((ball[0].points == p).all(axis=1))[0]) for p in after[0].points]
    assert sorted(j) == list(range(len(j)))
    for one, two in zip(ball, after, strict=True):
        np.testing.assert_array_equal(two.points, one.points[j])


def test_polygons_of_any_size_keep_their_corners_in_order():
    V = np.random.default_rng(0).normal(size=(7, 3))
    topology = Topology(np.array([4, 3, 5]), np.array([0, 1, 2, 3, 1, 4, 2, 2, 4, 5, 6, 0]), 7)
    still = MeshAnimation.from_frames([Frame(1.0, V, topology)])
    assert polygons(shuffled(still)[0]) == polygons(still[0])
