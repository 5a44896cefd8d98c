from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from meshmark.mesh.topology import (
    boundary_edges,
    edges,
    face_adjacency,
    face_components,
    faces_about_vertices,
    triangulate,
    vertex_adjacency,
    vertex_components,
    weld,
)

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
SQUARE = np.array([[0, 1, 2], [0, 2, 3]])


def test_polygons_become_fans() -> None:
    counts, indices = np.array([3, 5, 4]), np.arange(12)
    expected = [[0, 1, 2], [3, 4, 5], [3, 5, 6], [3, 6, 7], [8, 9, 10], [8, 10, 11]]
    assert triangulate(counts, indices).tolist() == expected


@given(st.lists(st.integers(3, 7), min_size=1, max_size=20))
def test_a_fan_has_two_triangles_less_than_corners(counts) -> None:
    F = triangulate(np.array(counts), np.arange(sum(counts)))
    assert len(F) == sum(counts) - 2 * len(counts)
    assert len(np.unique(F)) == sum(counts)


def test_edges_by_hand() -> None:
    assert edges(SQUARE).tolist() == [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]]
    assert boundary_edges(SQUARE).tolist() == [[0, 1], [0, 3], [1, 2], [2, 3]]
    assert len(edges(TETRAHEDRON)) == 6
    assert len(boundary_edges(TETRAHEDRON)) == 0


def test_degenerate_faces_have_no_loop_edge() -> None:
    assert edges(np.array([[4, 4, 7]])).tolist() == [[4, 7]]


def test_face_adjacency_of_a_square() -> None:
    pairs, shared = face_adjacency(SQUARE)
    assert pairs.tolist() == [[0, 1]]
    assert shared.tolist() == [[0, 2]]


def test_faces_about_vertices_of_a_square() -> None:
    start, about = faces_about_vertices(SQUARE)
    assert [about[i:j].tolist() for i, j in pairwise(start)] == [[0, 1], [0], [0, 1], [1]]


def test_a_closed_surface_has_three_halves_of_its_faces_as_pairs() -> None:
    pairs, shared = face_adjacency(TETRAHEDRON)
    assert len(pairs) == 6
    for (f, g), edge in zip(pairs, shared, strict=True):
        assert set(edge) == set(TETRAHEDRON[f]) & set(TETRAHEDRON[g])


def test_one_ring_is_symmetric() -> None:
    A = vertex_adjacency(SQUARE, 4).toarray()
    np.testing.assert_array_equal(A, A.T)
    assert A.sum(axis=1).tolist() == [3, 2, 3, 2]


def test_components() -> None:
    F = np.concatenate([SQUARE, TETRAHEDRON + 4])
    assert vertex_components(F, 9).tolist() == [0, 0, 0, 0, 1, 1, 1, 1, 2]
    assert face_components(F).tolist() == [0, 0, 1, 1, 1, 1]
    assert face_components(SQUARE, np.array([0, 1])).tolist() == [0, 1]


def test_weld_keeps_first_appearance_and_faces() -> None:
    V = np.array([[1.0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0]])
    F = np.array([[0, 1, 3], [2, 3, 4]])
    W, G, new = weld(V, F)
    assert W.tolist() == [[1, 0, 0], [0, 0, 0], [0, 1, 0]]
    assert new.tolist() == [0, 1, 0, 2, 1]
    np.testing.assert_array_equal(W[G], V[F])
