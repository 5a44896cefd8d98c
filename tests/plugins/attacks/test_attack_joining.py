from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.topology import (
    Topology,
    boundary_edges,
    edges,
    face_components,
    vertex_components,
)
from meshmark.testing.attacks import AttackSuite, bending_ball
from meshmark.testing.meshes import cylinder
from meshmark_plugins.attacks import RECORDS

RECORD = {record.name: record for record in RECORDS}["joining"]


class TestJoining(AttackSuite):
    @pytest.fixture
    def record(self):
        return RECORD


class TestJoinedSheet(TestJoining):
    @pytest.fixture
    def parameters(self):
        return {"thing": "sheet"}


def joined(animation, seed=0, **parameters):
    return RECORD.factory(**parameters).apply(animation, np.random.default_rng(seed))


def added(animation, **parameters):
    """Split what was joined off: its points in every frame, and its faces."""
    after = joined(animation, **parameters)
    n, faces = len(animation[0].points), len(animation[0].faces)
    for before, frame in zip(animation, after, strict=True):
        np.testing.assert_array_equal(frame.points[:n], before.points)
        np.testing.assert_array_equal(frame.faces[:faces], before.faces)
        assert frame.topology.same_as(after[0].topology)
    return np.array([frame.points[n:] for frame in after]), after[0].faces[faces:] - n


@pytest.mark.parametrize("thing", ["ground", "box", "body"])
def test_what_lies_beside_is_a_surface_of_its_own_and_moves_with_the_mean(thing):
    ball = bending_ball()
    points, F = added(ball, thing=thing, size=2.0)
    means = np.array([frame.points.mean(axis=0) for frame in ball])
    drift = np.broadcast_to((means - means[0])[:, None], points.shape)
    np.testing.assert_allclose(points - points[0], drift, atol=1e-12)
    assert F.min() == 0
    extent = np.ptp(ball[0].points, axis=0).max()
    assert np.ptp(points[0], axis=0).max() == pytest.approx(2.0 * extent)
    assert len(np.unique(vertex_components(F, points.shape[1]))) == 1
    assert len(boundary_edges(F)) == (4 * 39 if thing == "ground" else 0)


def test_a_ground_touches_the_lowest_point_and_a_box_holds_the_mesh():
    ball = bending_ball()
    ground = added(ball, thing="ground")[0][0]
    np.testing.assert_allclose(ground[:, 1], ball[0].points[:, 1].min())
    box = added(ball, thing="box")[0][0]
    assert np.all(box.min(axis=0) < ball[0].points.min(axis=0))
    assert np.all(box.max(axis=0) > ball[0].points.max(axis=0))


@pytest.mark.parametrize("area", [0.5, 5.0])
def test_a_sheet_has_its_area_is_hidden_and_hangs_on_an_edge(area):
    ball = bending_ball()
    points, F = added(ball, thing="sheet", area=area)
    flap, sheet = F[:2], F[2:]
    body = face_areas(ball[0].points, ball[0].faces).sum()
    assert face_areas(points[0], sheet).sum() == pytest.approx(area * body, rel=1e-3)
    # Within the ball of radius 1 about its centre.
    assert np.linalg.norm(points[0] - ball[0].points.mean(axis=0), axis=1).max() < 0.5
    a, b = np.unique(flap[flap < 0]) + len(ball[0].points)
    assert [a, b] in edges(ball[0].faces).tolist()
    assert len(np.unique(face_components(joined(ball, thing="sheet")[0].faces))) == 1


def test_a_wall_closes_a_tube_off_along_its_own_edges():
    V, F = cylinder(24, 40)
    tube = MeshAnimation.from_arrays(V, F)
    points, wall = added(tube, thing="wall")
    n = len(V)
    rim = wall[:, :2] + n
    assert points.shape[1] == 1
    known = {tuple(edge) for edge in edges(F).tolist()}
    assert {tuple(edge) for edge in np.sort(rim, axis=1).tolist()} <= known
    # Without the edges that it stands on, the tube falls apart.
    after = joined(tube, thing="wall")[0].faces
    assert len(np.unique(face_components(after))) == 1
    np.testing.assert_allclose(points[0, 0], V[np.unique(rim)].mean(axis=0))


def test_a_wall_stands_on_edges_of_polygons_not_on_diagonals():
    # Two quads, side by side: they share one edge, and the diagonals are nobody's.
    V = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]])
    topology = Topology(np.array([4, 4]), np.array([0, 1, 2, 3, 1, 4, 5, 2]), 6)
    after = joined(MeshAnimation.from_frames([Frame(1.0, V, topology)]), thing="wall")[0]
    assert after.topology.counts.tolist() == [4, 4, 3]
    assert after.topology.indices[8:].tolist() == [1, 2, 6]
    np.testing.assert_allclose(after.points[6], [1.0, 0.5, 0.0])


def test_a_wall_needs_an_edge_between_two_polygons():
    V, F = np.eye(3), np.array([[0, 1, 2]])
    with pytest.raises(InputError, match="no edge that a wall could stand on"):
        joined(MeshAnimation.from_arrays(V, F), thing="wall")
