"""Compiled heat-method distances: where they are known in closed form, and beside potpourri3d's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix, csr_matrix, diags_array

from meshmark import kernels
from meshmark.mesh import heat_distances
from meshmark.mesh.heat_distances import POISSON_SHIFT, heat_topology, side_twins
from meshmark.mesh.laplacian import stiffness_matrix
from meshmark.testing.meshes import bumpy_sphere, cylinder, dumbbell, icosphere, plane, torus
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances, distance_topology

pytest.importorskip("numba")

HORNS = np.array([[1, 0.2, 0.1], [-0.3, 1, 0.2], [-0.6, -0.7, 0.5]])


def rough(V, amount, seed=0):
    """Move vertices at random, by shares of the mean distance between them."""
    spacing = np.linalg.norm(np.ptp(V, axis=0)) / np.sqrt(len(V))
    return V + amount * spacing * np.random.default_rng(seed).normal(size=V.shape)


def distances(topology, V, diffusion=0.2):
    measured = topology.distances(V, diffusion).from_vertices(np.array([0, 7]))
    return measured - measured[np.arange(2), [0, 7], None]


def test_distances_on_a_sphere_are_arcs():
    V, _ = icosphere(4)
    topology = heat_topology(*icosphere(4, radius=3.0))
    arcs = np.arccos(np.clip(V[[0, 7]] @ V.T, -1.0, 1.0))
    np.testing.assert_allclose(distances(topology, V), arcs, atol=0.008 * np.pi)


@pytest.mark.parametrize(
    "mesh", [torus(40, 20), dumbbell(24, 48), bumpy_sphere(3, HORNS), cylinder(30, 30), plane(20)]
)
@pytest.mark.parametrize("amount", [0.0, 0.15])
def test_they_are_those_of_potpourri_in_other_poses(mesh, amount):
    V, F = mesh
    topology = distance_topology(V, F)
    pose = rough(V * [1.0, 1.3, 0.8], amount)
    own = GeodesicDistances(pose, F, topology=topology)
    assert own._compiled is not None
    sources = np.array([0, 7, len(V) // 2])
    np.testing.assert_allclose(
        own.from_vertices(sources), GeodesicDistances(pose, F).from_vertices(sources), atol=0.006
    )
    np.testing.assert_allclose(own.from_vertices(sources)[1], own.from_vertex(7), atol=1e-12)


def test_slivers_and_triangles_without_area_are_no_obstacle():
    V, F = torus(40, 20)
    crushed = V.copy()
    crushed[F[100, 1]] = crushed[F[100, 0]]
    crushed[F[500, 2]] = 0.5 * (crushed[F[500, 0]] + crushed[F[500, 1]])
    sources = np.array([0, 7])
    np.testing.assert_allclose(
        GeodesicDistances(crushed, F, topology=distance_topology(V, F)).from_vertices(sources),
        GeodesicDistances(crushed, F).from_vertices(sources),
        atol=0.006,
    )


def triangulation(V, F):
    return kernels.load_loops(heat_distances.DELAUNAY_LOOPS).delaunay(F, V, side_twins(F))


def test_triangles_become_delaunay_and_keep_the_surface():
    V, F = bumpy_sphere(3, HORNS)
    V = rough(V, 0.3)
    T, side = triangulation(V, F)
    a, b, c = side[:, 0], side[:, 1], side[:, 2]
    angles = np.arccos(
        np.stack(
            [(q * q + r * r - p * p) / (2 * q * r) for p, q, r in [(a, b, c), (b, c, a), (c, a, b)]]
        )
    ).T
    twins = side_twins(T)
    # Sides that a vertex shares with itself, or two vertices with each other twice, have no twin.
    if twins is not None:
        opposite = angles + angles.ravel()[twins]
        assert opposite.max() < np.pi + 1e-6
    np.testing.assert_allclose(angles.sum(axis=1), np.pi, atol=1e-9)
    # Angles about a vertex add up to what they were: no flip changes the surface.
    ends = [V[F[:, (k + 1) % 3]] - V[F[:, k]] for k in range(3)]
    before = [
        np.arccos(
            np.vecdot(ends[k], -ends[k - 1])
            / np.linalg.norm(ends[k], axis=1)
            / np.linalg.norm(ends[k - 1], axis=1)
        )
        for k in range(3)
    ]
    np.testing.assert_allclose(
        np.bincount(T.ravel(), angles.ravel()),
        np.bincount(F.ravel(), np.stack(before, axis=1).ravel()),
        atol=1e-6,
    )


def test_both_matrices_are_factored_whatever_the_order():
    V, F = torus(20, 12)
    n = len(V)
    triangles = kernels.load_loops(heat_distances.DELAUNAY_LOOPS)
    loops = kernels.load_loops(heat_distances.FACTOR_LOOPS)
    T, side = triangulation(rough(V, 0.2), F)
    place = np.random.default_rng(0).permutation(n)
    start, rows, values, diagonal, areas = triangles.laplacian(T, side, place)
    parent, filled = loops.elimination_tree(start, rows)
    shift = np.stack([areas + 0.04 * diagonal, diagonal + POISSON_SHIFT * areas])
    scales = np.array([0.04, 1.0])
    below, L, D = loops.factors(start, rows, values, shift, scales, parent, filled)
    above = csr_matrix((values, rows, start), (n, n))
    for which in range(2):
        A = (scales[which] * (above + above.T) + diags_array(shift[which])).toarray()
        lower = csr_matrix((L[which], below, filled), (n, n)).toarray().T + np.eye(n)
        np.testing.assert_allclose(lower * D[which] @ lower.T, A, atol=1e-9)
        X = np.random.default_rng(1).normal(size=(n, 3))
        for some in (X.copy(), X[:, :1].copy()):
            wanted = np.linalg.solve(A, some)
            loops.solve(filled, below, L[which], D[which], some)
            np.testing.assert_allclose(some, wanted, rtol=1e-6, atol=1e-8 * np.abs(wanted).max())
    # The Laplacian is that of the triangles.
    i, j = place[T], place[np.roll(T, -1, axis=1)]
    assert coo_matrix((np.ones(i.size), (i.ravel(), j.ravel())), (n, n)).nnz >= above.nnz / 2
    np.testing.assert_allclose(diagonal, -np.asarray((above + above.T).sum(axis=1)).ravel())


def test_an_order_for_other_triangles_leaves_little_fill():
    V, F = bumpy_sphere(4, HORNS)
    topology = heat_topology(V, F)
    pose = rough(V * [1.0, 1.3, 0.8], 0.05)
    other, best = topology.distances(pose, 0.2), heat_topology(pose, F).distances(pose, 0.2)
    assert np.any(other._place != topology.place)
    assert sorted(other._place) == list(range(len(V)))
    assert other._filled[-1] < 1.6 * best._filled[-1]


def test_surfaces_that_are_no_manifold_are_left_to_others():
    V, F = icosphere(1)
    assert heat_topology(V, np.concatenate([F, F[:1]])) is None
    assert heat_topology(V, np.concatenate([F[:-1], F[-1:, ::-1]])) is None
    two = np.concatenate([F, [[F[0, 1], F[0, 0], len(V)]]])
    assert heat_topology(np.concatenate([V, [[0.0, 0.0, 3.0]]]), two) is None


def test_twins_are_the_other_sides():
    _, F = torus(8, 5)
    twins = side_twins(F)
    tail, head = np.roll(F, -1, axis=1).ravel(), np.roll(F, -2, axis=1).ravel()
    np.testing.assert_array_equal(tail[twins], head.reshape(-1, 3))
    np.testing.assert_array_equal(head[twins], tail.reshape(-1, 3))
    assert np.count_nonzero(side_twins(plane(4)[1]) < 0) == 12


def test_without_numba_there_is_none(monkeypatch):
    monkeypatch.setattr(heat_distances, "load_loops", lambda name: None)
    V, F = icosphere(1)
    assert heat_topology(V, F) is None
    assert distance_topology(V, F) is None


def test_the_same_laplacian_as_of_the_mesh_where_nothing_is_flipped():
    V, F = icosphere(2)
    loops = kernels.load_loops(heat_distances.DELAUNAY_LOOPS)
    T, side = triangulation(V, F)
    np.testing.assert_array_equal(T, F)
    n = len(V)
    start, rows, values, diagonal, _ = loops.laplacian(T, side, np.arange(n))
    above = csr_matrix((values, rows, start), (n, n))
    corners = [V[F[:, k]] for k in range(3)]
    cot = np.stack(
        [
            np.vecdot(corners[k - 2] - corners[k], corners[k - 1] - corners[k])
            / np.linalg.norm(
                np.cross(corners[k - 2] - corners[k], corners[k - 1] - corners[k]), axis=1
            )
            for k in range(3)
        ],
        axis=1,
    )
    wanted = stiffness_matrix(F, 0.5 * cot, n)
    found = above + above.T + diags_array(diagonal)
    assert np.abs((found - wanted).toarray()).max() < 1e-9
