from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshmark.mesh.deformation import Deformation, OneRings
from meshmark.testing.meshes import icosphere, plane, torus

ROTATION = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
AFFINE = np.array([[1.3, 0.4, -0.2], [0.1, 0.7, 0.5], [-0.3, 0.2, 1.1]])
SHIFT = np.array([5.0, -3, 2])

OPEN_AND_CLOSED = pytest.mark.parametrize(
    "mesh",
    [plane(7), icosphere(1), icosphere(3), torus(24, 12)],
    ids=["plane", "coarse", "sphere", "torus"],
)


def flat_ring_of_a_hexagon():
    angle = np.arange(6) * np.pi / 3
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(6)], axis=1)
    V = np.concatenate([np.zeros((1, 3)), rim])
    spokes = 1 + np.arange(6)
    return V, np.stack([np.zeros(6, dtype=int), spokes, np.roll(spokes, -1)], axis=1)


def all_equal(gradients, matrix, atol=1e-12):
    np.testing.assert_allclose(gradients, np.broadcast_to(matrix, gradients.shape), atol=atol)


def test_stretching_a_flat_ring_stretches_the_normal_as_its_area_asks():
    V, F = flat_ring_of_a_hexagon()
    found = Deformation(V, F).gradients(V * [4, 9, 1])
    all_equal(found, np.diag([4.0, 9.0, 6.0]))


@OPEN_AND_CLOSED
def test_rotations_and_scales_are_found_exactly(mesh):
    V, F = mesh
    for scale in (1.0, 0.01, 30.0):
        found = Deformation(V, F).gradients(scale * V @ ROTATION.T + SHIFT)
        all_equal(found / scale, ROTATION, atol=1e-11)


@OPEN_AND_CLOSED
def test_an_affine_map_is_found_exactly_in_the_tangent_plane(mesh):
    V, F = mesh
    found = Deformation(V, F).gradients(V @ AFFINE.T + SHIFT)
    # What differs from the map sees one direction only, and the plane across it is exact.
    _, error, axes = np.linalg.svd(found - AFFINE)
    np.testing.assert_allclose(error[:, 1:], 0, atol=1e-11)
    # That direction goes across the surface, on the same side, as long as the area asks.
    a, b = axes[:, 1] @ AFFINE.T, axes[:, 2] @ AFFINE.T
    n = np.cross(a, b) * np.linalg.det(axes)[:, None]
    n /= np.sqrt(np.linalg.norm(n, axis=1, keepdims=True))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", found, axes[:, 0]), n, atol=1e-9)


def test_the_exact_plane_is_the_tangent_plane_of_a_smooth_surface():
    V, F = icosphere(4)
    axes = np.linalg.svd(Deformation(V, F).gradients(V @ AFFINE.T) - AFFINE)[2]
    # One-rings on a sphere are nearly symmetric: within a degree.
    assert np.abs(np.einsum("ni,ni->n", axes[:, 0], V)).min() > np.cos(np.radians(1))


def test_a_sheet_rolled_up_turns_each_vertex_with_its_place():
    # z = 0 rolled about the y axis on radius r: a vertex turns by x / r about y, lengths stay.
    V, F = plane(61, side=1.0)
    r = 0.5
    turn = V[:, 0] / r
    rolled = np.stack([r * np.sin(turn), V[:, 1], r * (1 - np.cos(turn))], axis=1)
    found = Deformation(V, F).gradients(rolled)
    wanted = Rotation.from_rotvec(turn[:, None] * [0, -1, 0]).as_matrix()
    inner = (V[:, :2] > 0.01).all(axis=1) & (V[:, :2] < 0.99).all(axis=1)
    # An edge of length h is off its tangent by h / 2 r, which cancels but for its square.
    np.testing.assert_allclose(found[inner], wanted[inner], atol=(1 / 60 / r) ** 2)


def test_vectors_along_edges_are_carried_with_them():
    errors = []
    for level in (2, 3, 4):
        V, F = icosphere(level)
        tails, first = np.unique(F[:, 0], return_index=True)
        D = np.zeros_like(V)
        D[tails] = 0.1 * (V[F[first, 1]] - V[tails])
        carried = Deformation(V, F).carry(D, V @ AFFINE.T)
        errors.append(np.linalg.norm(carried - D @ AFFINE.T) / np.linalg.norm(D @ AFFINE.T))
    # All but their height over the tangent plane is exact, and that halves with the edges.
    assert errors[0] < 0.15
    np.testing.assert_allclose(np.divide(errors[:-1], errors[1:]), 2, rtol=0.1)


def test_edges_without_length_say_nothing():
    V, F = plane(4)
    # Vertex 16 stands where 5 does, joined to it and to a neighbour.
    V = np.concatenate([V, V[[5]]])
    F = np.concatenate([F, [[5, 16, 6]]])
    all_equal(Deformation(V, F).gradients(V @ ROTATION.T)[:16], ROTATION)
    # Opened a little, so short an edge must not outweigh the others.
    opened = V @ ROTATION.T
    opened[16] += 1e-3
    found = Deformation(V, F).gradients(opened)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found[5], ROTATION, atol=1e-12)


def test_what_has_no_edges_stays():
    V = np.concatenate([plane(3)[0], np.ones((2, 3))])
    F = np.concatenate([plane(3)[1], [[9, 9, 9]]])
    all_equal(Deformation(V, F).gradients(V @ AFFINE.T)[9:], np.eye(3))
    all_equal(Deformation(0 * V, F).gradients(V), np.eye(3))


def test_a_ring_that_collapses_or_lies_in_a_line_stays_finite():
    V, F = plane(5)
    line = V * [1, 0, 0]
    for before, after in [(V, line), (V, 0 * V), (line, V), (line, line)]:
        assert np.isfinite(Deformation(before, F).gradients(after)).all()
    # Along the line there is something to follow.
    found = Deformation(line, F).gradients(3 * line @ ROTATION.T)
    np.testing.assert_allclose(found[:, :, 0], np.broadcast_to(3 * ROTATION[:, 0], (25, 3)))


def test_the_order_of_vertices_and_faces_does_not_matter():
    V, F = torus(20, 10)
    target = V + 0.1 * np.sin(3 * V[:, [1, 2, 0]])
    rng = np.random.default_rng(0)
    order = rng.permutation(len(V))
    place = np.argsort(order)
    mixed = Deformation(V[order], place[F][rng.permutation(len(F))]).gradients(target[order])
    np.testing.assert_allclose(mixed[place], Deformation(V, F).gradients(target), atol=1e-12)


def test_some_vertices_tell_what_all_of_them_would():
    V, F = torus(20, 10)
    target = V + 0.1 * np.sin(3 * V[:, [1, 2, 0]])
    at = np.array([7, 3, 150])
    some = Deformation(V, F, OneRings(F, len(V), at))
    every = Deformation(V, F)
    np.testing.assert_allclose(some.gradients(target), every.gradients(target)[at], atol=1e-14)
    carried = every.carry(V, target)
    np.testing.assert_allclose(some.carry(V[at], target), carried[at], atol=1e-14)
