from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshmark.mesh.components import seams, sewn, surface_components
from meshmark.mesh.topology import face_components
from meshmark.testing.meshes import capsule, icosphere, plane, side_by_side, torus

TWO_TRIANGLES = np.array([[0, 1, 2], [1, 0, 3]])


def split(V, F, label) -> tuple[np.ndarray, np.ndarray]:
    """Give every label's triangles vertices of their own."""
    points, faces, n = [], [], 0
    for one in np.unique(label):
        used, local = np.unique(F[label == one], return_inverse=True)
        points.append(V[used])
        faces.append(local.reshape(-1, 3) + n)
        n += len(used)
    return np.concatenate(points), np.concatenate(faces)


def same_partition(a, b) -> bool:
    pairs = np.unique(np.stack([a, b], axis=1), axis=0)
    return len(pairs) == len(np.unique(a)) == len(np.unique(b))


@pytest.mark.parametrize("mesh", [icosphere(2), torus(24, 12), plane(5), capsule(24, 30)])
def test_a_manifold_is_one_surface(mesh) -> None:
    V, F = mesh
    assert not surface_components(V, F).any()


def test_bodies_side_by_side_are_numbered_by_their_first_triangle() -> None:
    V, F = side_by_side(icosphere(1), torus(12, 8), icosphere(0))
    np.testing.assert_array_equal(surface_components(V, F), face_components(F))


def test_at_an_edge_of_three_the_two_that_go_on_straight_belong_together() -> None:
    # A flat strip, and a flap that stands up on its middle edge, at every angle.
    for angle in np.radians([30, 60, 89, 91, 120, 150]):
        flap = [0.5, np.cos(angle), np.sin(angle)]
        V = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0], flap])
        F = np.array([*TWO_TRIANGLES, [0, 1, 4]])
        assert surface_components(V, F).tolist() == [0, 0, 1]


def test_two_sheets_that_cross_are_two_surfaces() -> None:
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0], [0.5, 0, 1], [0.5, 0, -1]])
    F = np.array([[0, 1, 2], [0, 1, 4], [1, 0, 3], [1, 0, 5]])
    assert surface_components(V, F).tolist() == [0, 1, 0, 1]


def test_a_wall_through_a_body_is_no_part_of_it_although_some_edges_are_sharp() -> None:
    V, F = icosphere(3)
    rng = np.random.default_rng(0)
    V = V * rng.uniform(0.9, 1.1, size=(len(V), 1))
    front = V[F].mean(axis=1)[:, 0] > 0.1
    sides = np.sort(np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]), axis=1)
    owner = np.tile(front, 3)
    rows, counts = np.unique(sides[owner], axis=0, return_counts=True)
    loop = rows[counts == 1]
    hub = len(V)
    wall = np.column_stack([loop, np.full(len(loop), hub)])
    label = surface_components(np.vstack([V, [0.1, 0, 0]]), np.concatenate([F, wall]))
    assert not label[: len(F)].any()
    assert (label[len(F) :] == 1).all()


def test_more_triangles_about_an_edge_than_are_looked_at_join_nothing() -> None:
    n = 40
    around = np.linspace(0, 2 * np.pi, n, endpoint=False)
    V = np.vstack(
        [[0, 0, 0], [0, 0, 1], np.column_stack([np.cos(around), np.sin(around), 0 * around])]
    )
    F = np.column_stack([np.zeros(n), np.ones(n), np.arange(2, n + 2)]).astype(int)
    assert surface_components(V, F).tolist() == list(range(n))


@given(st.integers(0, 2**32 - 1))
def test_surfaces_are_the_same_after_a_similarity_and_in_any_order(seed) -> None:
    rng = np.random.default_rng(seed)
    V, F = side_by_side(icosphere(1), torus(12, 8))
    # A flap on an edge of the sphere.
    V = np.vstack([V, 3 * V[F[0]].mean(axis=0)])
    F = np.vstack([F, [F[0, 0], F[0, 1], len(V) - 1]])
    label = surface_components(V, F)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    order, names = rng.permutation(len(F)), rng.permutation(len(V))
    moved = np.empty_like(V)
    moved[names] = V @ turn * rng.uniform(0.1, 10) + rng.normal(size=3)
    assert same_partition(surface_components(moved, names[F][order]), label[order])


@pytest.mark.parametrize("gap", [0.0, 1e-6, 1e-3])
def test_a_cut_is_sewn_up_and_nothing_else_is(gap) -> None:
    V, F = icosphere(3)
    label = (V[F].mean(axis=1) @ [1.0, 0.3, -0.2] > 0.2).astype(int)
    cut, faces = split(V, F, label)
    cut = cut + gap * (np.arange(len(cut)) >= len(np.unique(F[label == 0])))[:, None]
    pairs = seams(cut, faces)
    assert len(pairs) == len(cut) - len(V)
    mended = sewn(len(cut), pairs)[faces]
    assert len(np.unique(mended)) == len(V)
    assert not surface_components(cut, mended).any()
    assert seams(cut, mended).size == 0


def test_borders_farther_apart_than_a_cut_stay_apart() -> None:
    V, F = plane(6, side=5.0)
    both, faces = side_by_side((V, F), (V, F))
    lifted = both.copy()
    lifted[len(V) :, 2] += 0.5
    assert seams(lifted, faces).size == 0
    # Two sheets of one outline, a hair apart, are sewn along it, not through it.
    lifted[:, 2] = np.where(np.arange(len(both)) < len(V), 0.0, 1e-4)
    assert len(seams(lifted, faces)) == 20


def test_what_is_sewn_is_measured_by_the_edges_about_it_not_by_those_elsewhere() -> None:
    V, F = plane(6, side=5.0)
    big, faces = side_by_side((V * 1e-3, F), (V * 1e6 + 0.5, F))
    assert seams(big, faces).size == 0


def test_an_open_strip_of_slivers_is_not_sewn_to_itself_along_its_edges() -> None:
    V = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1e-9, 0]])
    assert seams(V, np.array([[0, 1, 2]])).size == 0
