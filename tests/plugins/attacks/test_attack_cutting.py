from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology, face_components
from meshmark.testing.attacks import AttackSuite, bending_ball
from meshmark.testing.meshes import icosphere, side_by_side
from meshmark_plugins.attacks import RECORDS

RECORD = {record.name: record for record in RECORDS}["cutting"]


class TestCutting(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD


def pieces(animation, seed=0, **parameters):
    return RECORD.factory(**parameters).apply(animation, np.random.default_rng(seed))


@pytest.mark.parametrize("n", [1, 2, 12])
def test_the_pieces_are_as_many_as_asked_for_and_connected(n):
    ball = bending_ball()
    after = pieces(ball, patches=n)
    assert len(np.unique(face_components(after[0].faces))) == n
    assert len(after[0].faces) == len(ball[0].faces)


def test_pieces_move_as_a_whole_by_the_gap_alike_in_all_frames():
    ball = bending_ball()
    after = pieces(ball, gap=0.01)
    corners = ball[0].faces, after[0].faces
    d = np.linalg.norm(ball[0].points - ball[0].points.mean(axis=0), axis=1).mean()
    piece = face_components(after[0].faces)
    before, behind = (np.array([frame.points for frame in each]) for each in (ball, after))
    moves = behind[:, corners[1]] - before[:, corners[0]]
    np.testing.assert_allclose(np.linalg.norm(moves, axis=3), 0.01 * d)
    for one in np.unique(piece):
        move = moves[:, piece == one].reshape(-1, 3)
        np.testing.assert_allclose(move, np.broadcast_to(move[0], move.shape), atol=1e-12)


def test_without_a_gap_the_corners_stay_and_points_along_cuts_are_doubled():
    ball = bending_ball()
    after = pieces(ball, gap=0)
    np.testing.assert_array_equal(after[2].points[after[2].faces], ball[2].points[ball[2].faces])
    assert len(ball[0].points) < len(after[0].points) < 2 * len(ball[0].points)


def test_what_no_piece_reaches_stays_together():
    balls = side_by_side(*[icosphere(1)] * 4)
    after = pieces(MeshAnimation.from_arrays(*balls), patches=1, gap=1e-3)[0]
    moves = after.points[after.faces] - balls[0][balls[1]]
    # One ball was reached; the three others went the same way.
    assert len(np.unique(moves.reshape(-1, 3).round(9), axis=0)) == 2


def test_polygons_stay_and_are_never_cut_along_a_diagonal():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]])
    topology = Topology(np.array([4, 4]), np.array([0, 1, 2, 3, 1, 4, 5, 2]), 6)
    after = pieces(MeshAnimation.from_frames([Frame(1.0, V, topology)]), patches=2)[0]
    assert after.topology.counts.tolist() == [4, 4]
    assert after.topology.n_points == 8


def test_a_mesh_of_fewer_polygons_falls_into_them():
    V, F = icosphere(0)
    after = pieces(MeshAnimation.from_arrays(V, F), patches=5000)[0]
    assert len(after.points) == 60
    assert len(np.unique(face_components(after.faces))) == len(F) == 20
