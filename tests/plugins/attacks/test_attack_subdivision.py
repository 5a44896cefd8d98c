from __future__ import annotations

import numpy as np
import pytest

from meshmark.errors import UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.subdivision import LIMITS, subdivide
from meshmark.mesh.topology import Topology, boundary_edges, edges
from meshmark.metrics import surface_distance
from meshmark.testing.attacks import AttackSuite, bending_ball, sphere
from meshmark.testing.meshes import icosphere, plane
from meshmark_plugins.attacks import RECORDS

BY_NAME = {record.name: record for record in RECORDS}
TRIANGLE = np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])


class TestSubdivision(AttackSuite):
    @pytest.fixture
    def record(self):
        return BY_NAME["subdivision"]


class TestLoopSubdivision(TestSubdivision):
    @pytest.fixture
    def parameters(self):
        return {"scheme": "loop"}


class TestSqrt3Subdivision(TestSubdivision):
    @pytest.fixture
    def parameters(self):
        return {"scheme": "sqrt3", "steps": 2}


def fine(V, F, **parameters):
    attack = BY_NAME["subdivision"].factory(**parameters)
    return attack.apply(MeshAnimation.from_arrays(V, F), np.random.default_rng(0))[0]


def signed_volume(V, F):
    a, b, c = (V[F[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def octahedron():
    V = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    upper = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4]]
    lower = [[2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    return V, np.array(upper + lower)


def test_midpoint_on_one_triangle_by_hand():
    frame = fine(TRIANGLE, np.array([[0, 1, 2]]))
    np.testing.assert_array_equal(
        frame.points, [*TRIANGLE.tolist(), [2, 0, 0], [0, 2, 0], [2, 2, 0]]
    )
    assert frame.faces.tolist() == [[0, 3, 4], [3, 1, 5], [4, 5, 2], [3, 5, 4]]


def test_midpoint_keeps_the_surface():
    V, F = sphere(300)
    frame = fine(V, F, scheme="midpoint", steps=2)
    assert len(frame.faces) == 16 * len(F)
    assert surface_distance(V, F, frame.points, frame.faces).hausdorff < 1e-7
    assert signed_volume(frame.points, frame.faces) == pytest.approx(signed_volume(V, F))


@pytest.mark.parametrize(("scheme", "growth"), [("midpoint", 4), ("loop", 4), ("sqrt3", 3)])
def test_closed_surfaces_stay_closed_oriented_and_of_the_same_genus(scheme, growth):
    V, F = sphere(300)
    frame = fine(V, F, scheme=scheme)
    assert len(frame.faces) == growth * len(F)
    assert len(boundary_edges(frame.faces)) == 0
    assert len(frame.points) - len(edges(frame.faces)) + len(frame.faces) == 2
    half = frame.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(half, axis=0)) == len(half)
    assert signed_volume(frame.points, frame.faces) > 0.9 * signed_volume(V, F)


def test_loop_on_an_octahedron_by_hand():
    # Corners have four neighbours that average to 0: each keeps 1 - 4 b, with
    # b = (5/8 - (3/8)^2) / 4; edge points are 3/8 of two corners, the opposite two cancel.
    V, F = octahedron()
    frame = fine(V, F, scheme="loop")
    keep = 1 - (5 / 8 - (3 / 8) ** 2)
    np.testing.assert_allclose(frame.points[:6], keep * V, atol=1e-15)
    E = edges(F)
    np.testing.assert_allclose(frame.points[6:], 0.375 * (V[E[:, 0]] + V[E[:, 1]]), atol=1e-15)


def test_loop_borders_are_cubic_splines():
    frame = fine(TRIANGLE, np.array([[0, 1, 2]]), scheme="loop")
    # Corner: 3/4 of itself and 1/8 of both neighbours; edge points are midpoints.
    wanted = [[0.5, 0.5, 0], [3, 0.5, 0], [0.5, 3, 0], [2, 0, 0], [0, 2, 0], [2, 2, 0]]
    np.testing.assert_allclose(frame.points, wanted)


def test_sqrt3_on_an_octahedron_by_hand():
    # a = (4 - 2 cos(pi / 2)) / 9 = 4/9, and the mean of the neighbours is 0.
    V, F = octahedron()
    frame = fine(V, F, scheme="sqrt3")
    np.testing.assert_allclose(frame.points[:6], 5 / 9 * V, atol=1e-15)
    np.testing.assert_allclose(frame.points[6:], V[F].mean(axis=1), atol=1e-15)
    # Every old edge is flipped away: none joins two old points.
    assert np.all((edges(frame.faces) >= 6).any(axis=1))


def test_sqrt3_keeps_borders():
    frame = fine(TRIANGLE, np.array([[0, 1, 2]]), scheme="sqrt3")
    np.testing.assert_allclose(frame.points, [*TRIANGLE.tolist(), [4 / 3, 4 / 3, 0]])
    assert sorted(map(sorted, frame.faces.tolist())) == [[0, 1, 3], [0, 2, 3], [1, 2, 3]]


@pytest.mark.parametrize("scheme", ["midpoint", "loop", "sqrt3"])
def test_a_plane_stays_plane_and_linear_functions_are_reproduced_inside(scheme):
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij"))
    k = np.arange(25).reshape(5, 5)
    a, b, c, d = (q.ravel() for q in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    F = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    frame = fine(np.stack([x, y, 2 * x - y], axis=1), F, scheme=scheme)
    P = frame.points
    np.testing.assert_allclose(P[:, 2], 2 * P[:, 0] - P[:, 1], atol=1e-12)


def test_edges_with_three_faces_and_twisted_faces_do_no_harm():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [1, 1, 1]])
    F = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [1, 2, 5], [1, 2, 4]])
    for scheme, growth in [("midpoint", 4), ("loop", 4), ("sqrt3", 3)]:
        frame = fine(V, F, scheme=scheme)
        assert len(frame.faces) == growth * len(F)
        assert np.isfinite(frame.points).all()


def test_polygons_are_triangulated_first():
    V = np.array([[0.0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]])
    quad = MeshAnimation.from_frames([Frame(1.0, V, Topology(np.array([4]), np.arange(4), 4))])
    frame = BY_NAME["subdivision"].factory().apply(quad, np.random.default_rng(0))[0]
    assert len(frame.faces) == 8


def test_all_frames_share_one_connectivity():
    attack = BY_NAME["subdivision"].factory(scheme="loop")
    frames = attack.apply(bending_ball(), np.random.default_rng(0))
    assert frames.constant_topology
    assert all(frames[0].topology.same_as(frame.topology) for frame in frames)


def cube():
    V = np.array([[x, y, z] for z in (-1.0, 1) for y in (-1.0, 1) for x in (-1.0, 1)])
    quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return V, np.array(quads)


def quads_of(V, Q, **parameters):
    topology = Topology(np.full(len(Q), 4), Q.ravel(), len(V))
    animation = MeshAnimation.from_frames([Frame(1.0, V, topology)])
    attack = BY_NAME["subdivision"].factory(scheme="catmull_clark", **parameters)
    return attack.apply(animation, np.random.default_rng(0))[0]


def test_catmull_clark_on_a_cube_by_hand():
    # Corner (1, 1, 1): a third each of itself, of the mean of its neighbours and of that of its
    # faces' points, both (1, 1, 1) / 3. Edge: the mean of (1, 1, +-1), (1, 0, 0) and (0, 1, 0).
    V, Q = cube()
    frame = quads_of(V, Q)
    np.testing.assert_allclose(frame.points[:8], 5 / 9 * V, atol=1e-15)
    np.testing.assert_allclose(np.sort(np.abs(frame.points[8:20])), [[0, 0.75, 0.75]] * 12)
    np.testing.assert_allclose(frame.points[20:], V[Q].mean(axis=1), atol=1e-15)


def test_catmull_clark_makes_oriented_quads_again_and_again():
    V, Q = cube()
    for steps in (1, 2, 3):
        frame = quads_of(V, Q, steps=steps)
        assert np.all(frame.topology.counts == 4)
        assert len(frame.topology.counts) == 6 * 4**steps
        half = frame.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        assert len(np.unique(half, axis=0)) == len(half)
        assert len(boundary_edges(frame.faces)) == 0
        assert len(frame.points) - len(edges(frame.faces)) + len(frame.faces) == 2
        assert signed_volume(frame.points, frame.faces) > 0


def test_catmull_clark_takes_triangles_and_pentagons():
    V, F = octahedron()
    topology = Topology(np.full(8, 3), F.ravel(), 6)
    W, finer = subdivide(topology, "catmull_clark", 1)
    assert np.all(finer.counts == 3 + 1)
    np.testing.assert_allclose(W @ np.ones(6), 1.0)
    # Four neighbours that average to 0; the points of the faces about (0, 0, 1) average to 1/3.
    np.testing.assert_allclose((W @ V)[:6], (2 / 4 + 1 / 4 / 3) * V, atol=1e-15)
    pentagon = Topology(np.array([5]), np.arange(5), 5)
    W, finer = subdivide(pentagon, "catmull_clark", 1)
    # One face alone: its corners stay, its edges get their middles.
    np.testing.assert_array_equal(W.toarray()[:5], np.eye(5))
    np.testing.assert_allclose(W.toarray()[-1], 0.2)
    assert finer.indices.reshape(-1, 4)[0].tolist() == [0, 5, 10, 6]


def test_catmull_clark_keeps_a_square_grid_square():
    k = np.arange(25).reshape(5, 5)
    Q = np.stack([k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]], axis=-1).reshape(-1, 4)
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij"))
    frame = quads_of(np.stack([x, y, 2 * x - y], axis=1), Q, steps=2)
    P = frame.points
    np.testing.assert_allclose(P[:, 2], 2 * P[:, 0] - P[:, 1], atol=1e-12)
    assert (
        surface_distance(
            np.array([[0.0, 0, 0], [4, 0, 8], [4, 4, 4], [0, 4, -4]]),
            np.array([[0, 1, 2], [0, 2, 3]]),
            P,
            frame.faces,
        ).hausdorff
        < 1e-9
    )


class TestLimitSurface(TestSubdivision):
    @pytest.fixture
    def parameters(self):
        return {"scheme": "loop", "limit": True}


def open_and_closed(scheme):
    """A closed surface with vertices of 4, 5 and 6 neighbours, and an open one with corners."""
    for V, F in (octahedron(), plane(4), icosphere(1)):
        topology = Topology.from_triangles(F, len(V))
        # The limit of Catmull and Clark's is weighed for quads.
        W, topology = subdivide(topology, scheme, 1)
        yield W @ V, topology


@pytest.mark.parametrize("scheme", LIMITS)
def test_the_limit_is_what_all_levels_go_to(scheme):
    for V, topology in open_and_closed(scheme):
        limit = LIMITS[scheme](topology)
        np.testing.assert_allclose(limit.sum(axis=1), 1.0, atol=1e-12)
        W, finer = subdivide(topology, scheme, 1)
        # The points of the next level have the same limit: the weights are exact.
        again = (LIMITS[scheme](finer) @ W)[: len(V)]
        np.testing.assert_allclose((again - limit).toarray(), 0.0, atol=1e-12)
        # What is left to go shrinks by a known share with every level.
        far = [
            np.abs(limit @ V - (subdivide(topology, scheme, k)[0] @ V)[: len(V)]).max()
            for k in (1, 4)
        ]
        assert 0.0 < far[1] < 0.1 * far[0]


def test_the_limit_of_a_bicubic_spline_by_hand():
    # Of a regular lattice: (1/6, 4/6, 1/6) in both directions.
    V, quads = quad_lattice(5)
    limit = LIMITS["catmull_clark"](quads).toarray()[12].reshape(5, 5)
    spline = np.array([1, 4, 1]) / 6
    np.testing.assert_allclose(limit[1:4, 1:4], np.outer(spline, spline), atol=1e-15)
    assert limit.sum() == pytest.approx(1.0)
    attacked = (
        BY_NAME["subdivision"]
        .factory(scheme="catmull_clark", limit=True)
        .apply(MeshAnimation.from_frames([Frame(1.0, V, quads)]), np.random.default_rng(0))[0]
    )
    # Linear functions are kept, away from the border.
    inner = np.abs(attacked.points[:, :2] - 2.0).max(axis=1) < 1.0
    assert np.abs(attacked.points[inner, 2] - attacked.points[inner, 0]).max() < 1e-12


def quad_lattice(n):
    y, x = np.divmod(np.arange(n * n), n)
    V = np.stack([x, y, x], axis=1).astype(float)
    a = np.arange(n * n).reshape(n, n)
    quads = np.stack([a[:-1, :-1], a[:-1, 1:], a[1:, 1:], a[1:, :-1]], axis=-1).reshape(-1, 4)
    return V, Topology(np.full(len(quads), 4), quads.ravel(), n * n)


def test_other_rules_have_no_limit_here():
    with pytest.raises(UsageError, match="one of loop, catmull_clark"):
        BY_NAME["subdivision"].factory(scheme="sqrt3", limit="yes")
