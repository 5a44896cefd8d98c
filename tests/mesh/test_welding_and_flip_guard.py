from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshmark.errors import CapacityError
from meshmark.mesh.animation import Frame
from meshmark.mesh.flip_guard import (
    REACH,
    allowed_shares,
    face_normals,
    mean_edge_lengths,
    restrain,
)
from meshmark.mesh.topology import Topology, edges
from meshmark.mesh.welding import MOST_AROUND, Welding
from meshmark.testing.meshes import icosphere, side_by_side


def grid(n: int) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(np.arange(n, dtype=float), np.arange(n, dtype=float), indexing="ij")
    V = np.stack([x.ravel(), y.ravel(), np.zeros(n * n)], axis=1)
    i = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    F = np.concatenate([np.stack([i, i + n, i + 1], 1), np.stack([i + 1, i + n, i + n + 1], 1)])
    return V, F


def unindexed(V: np.ndarray, F: np.ndarray) -> Frame:
    soup = V[F].reshape(-1, 3)
    return Frame(1.0, soup, Topology.from_triangles(np.arange(len(soup)).reshape(-1, 3), len(soup)))


def test_a_soup_of_triangles_is_welded_and_spread_back() -> None:
    V, F = grid(4)
    frame = unindexed(V, F)
    welding = Welding.of(frame)
    analysed = welding.frame(frame)
    assert len(analysed.points) == len(V)
    np.testing.assert_array_equal(analysed.points[analysed.faces], frame.points[frame.faces])
    D = np.random.default_rng(0).normal(size=analysed.points.shape)
    moved = frame.points + welding.spread(D)
    np.testing.assert_allclose(
        moved[frame.faces], (analysed.points + D)[analysed.faces], atol=1e-15
    )


def test_unused_points_stay_and_degenerate_faces_go() -> None:
    V, F = grid(3)
    points = np.concatenate([[[9.0, 9, 9]], V, [[0, 0, 0]]])
    faces = np.concatenate([F + 1, [[1, 1, 2], [1, 10, 2]]])
    frame = Frame(1.0, points, Topology.from_triangles(faces, len(points)))
    welding = Welding.of(frame)
    # Point 10 coincides with point 1, so that the last two faces have no extent.
    assert len(welding.faces) == len(F)
    spread = welding.spread(np.ones((len(V), 3)))
    assert spread[0].tolist() == [0, 0, 0]
    assert np.all(spread[1:] == 1)


def test_polygons_are_kept_where_none_of_their_triangles_was_dropped() -> None:
    # Two squares with a seam between them, and a square with a corner on another of its own.
    V = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    points = np.concatenate([V, V + np.array([1.0, 0, 0]), V + np.array([0.0, 1, 0])])
    points[11] = points[10]
    topology = Topology(np.full(3, 4), np.arange(12), 12)
    frame = Frame(1.0, points, topology)
    welding = Welding.of(frame)
    polygons = welding.polygons(topology)
    assert polygons.counts.tolist() == [4, 4, 3]
    seen = welding.frame(frame)
    assert seen.points[polygons.indices[:8]].tolist() == points[:8].tolist()
    assert sorted(map(tuple, polygons.triangles)) == sorted(map(tuple, seen.faces))


def test_a_mesh_of_nothing_but_needles_is_refused() -> None:
    frame = Frame(1.0, np.zeros((3, 3)), Topology.from_triangles(np.array([[0, 1, 2]]), 3))
    with pytest.raises(CapacityError, match="three distinct corners"):
        Welding.of(frame)


def test_edge_lengths_of_a_grid() -> None:
    V, F = grid(3)
    # A corner has two edges of length 1, or three with the diagonal.
    assert mean_edge_lengths(V, F)[0] == pytest.approx(1.0)
    assert mean_edge_lengths(V, F)[2] == pytest.approx((2 + np.sqrt(2)) / 3)


@given(st.integers(0, 10_000), st.floats(0.01, 30))
def test_restrained_moves_turn_no_face_and_stay_near(seed, size) -> None:
    V, F = grid(6)
    moved = V + size * np.random.default_rng(seed).normal(size=V.shape)
    kept = restrain(V, moved, F)
    assert np.all(np.einsum("ij,ij->i", face_normals(V, F), face_normals(kept, F)) > 0)
    length = np.linalg.norm(kept - V, axis=1)
    assert np.all(length <= REACH * mean_edge_lengths(V, F) * (1 + 1e-12))


def test_harmless_moves_are_left_alone() -> None:
    V, F = grid(5)
    moved = V + 0.05 * np.random.default_rng(1).uniform(-1, 1, size=V.shape)
    np.testing.assert_allclose(restrain(V, moved, F), moved, atol=1e-15)


@pytest.mark.parametrize("n", [11, 41, 121])
def test_one_vertex_that_is_held_back_stops_no_more_of_a_finer_mesh(n) -> None:
    """Its neighbours' moves, longer than edges, must not turn faces over, nor all be dropped."""
    V, F = grid(n)
    V /= n - 1
    slide = 0.05 * np.sin(np.pi * V[:, :1]) * np.sin(np.pi * V[:, 1:2]) * [1.0, 0.0, 0.0]
    middle = len(V) // 2
    slide[middle] *= -1.0
    ramp = 3.0
    share = allowed_shares(V, V + slide, F, np.inf, ramp=ramp)
    kept = V + share[:, None] * slide
    assert np.all(np.einsum("ij,ij->i", face_normals(V, F), face_normals(kept, F)) > 0)
    # What is held back is a disc with a radius of about three moves, however fine the mesh.
    assert share[middle] < 0.5 or n == 11
    assert share.mean() > 0.97
    a, b = edges(F).T
    way = ramp * np.maximum(abs(slide[a, 0]), abs(slide[b, 0]))
    assert np.all(abs(share[a] - share[b]) * way <= np.linalg.norm(V[a] - V[b], axis=1) + 1e-9)


def fan(n: int) -> tuple[np.ndarray, np.ndarray]:
    angle = np.linspace(0.0, 2 * np.pi, n, endpoint=False)
    V = np.vstack([np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)]), [[0, 0, 1.0]]])
    i = np.arange(n)
    return V + 5.0, np.column_stack([i, (i + 1) % n, np.full(n, n)])


@pytest.mark.parametrize("hung", [False, True])
def test_a_vertex_in_which_too_many_triangles_meet_is_a_hole(hung) -> None:
    ball, faces = icosphere(2)
    V, F = side_by_side((ball, faces), fan(MOST_AROUND + 1))
    if hung:
        # Its middle is a vertex of the ball.
        F = np.where(len(V) - 1 == F, 0, F)
    welding = Welding.of(Frame(1.0, V, Topology.from_triangles(F, len(V))))
    kept = np.arange(len(faces))
    if hung:
        kept = kept[~(faces == 0).any(axis=1)]
    np.testing.assert_array_equal(welding.faces, kept)
    V, F = side_by_side((ball, faces), fan(MOST_AROUND))
    assert len(Welding.of(Frame(1.0, V, Topology.from_triangles(F, len(V)))).faces) == len(F)


def test_a_polygon_of_too_many_corners_is_left_out() -> None:
    ball, faces = icosphere(2)
    n = 20_000
    corners, _ = fan(n)
    counts = np.append(np.full(len(faces), 3), n)
    indices = np.append(faces.ravel(), len(ball) + np.arange(n))
    V = np.concatenate([ball, corners[:n]])
    welding = Welding.of(Frame(1.0, V, Topology(counts, indices, len(V))))
    assert len(welding.faces) == len(faces)


def test_nothing_but_crowded_corners_is_no_mesh() -> None:
    V, F = fan(2 * MOST_AROUND)
    with pytest.raises(CapacityError, match="meet in a corner of every face"):
        Welding.of(Frame(1.0, V, Topology.from_triangles(F, len(V))))
