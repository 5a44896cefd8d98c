from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshmark.mesh.closest_in_triangle import closest_in_triangle
from meshmark.mesh.closest_points import ClosestPoints, sample_surface
from meshmark.mesh.geometry import normalized
from meshmark.testing.attacks import sphere
from meshmark.testing.meshes import icosphere, plane

TRIANGLE = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0]])


def closest(*points):
    P = np.array(points, dtype=float)
    corners = [np.repeat(corner[None], len(P), axis=0) for corner in TRIANGLE]
    return closest_in_triangle(P, *corners) @ TRIANGLE


def test_every_region_about_a_triangle():
    found = closest([0.5, 0.2, 3], [-1, -1, 1], [3, 0, 0], [0, 5, 0], [1, -2, 0], [-1, 0.5, 0])
    wanted = [[0.5, 0.2, 0], [0, 0, 0], [2, 0, 0], [0, 1, 0], [1, 0, 0], [0, 0.5, 0]]
    np.testing.assert_allclose(found, wanted, atol=1e-15)
    # Beyond the hypotenuse x + 2 y = 2 the foot is on it.
    np.testing.assert_allclose(closest([2, 2, 7]), [[1.2, 0.4, 0]], atol=1e-15)


@given(st.integers(0, 2**32 - 1))
def test_no_point_of_the_triangle_is_closer(seed):
    rng = np.random.default_rng(seed)
    a, b, c, p = rng.normal(size=(4, 1, 3)) * 10.0 ** rng.uniform(-3, 3, size=(4, 1, 1))
    weights = closest_in_triangle(p, a, b, c)
    assert weights.min() >= 0
    assert weights.sum() == pytest.approx(1)
    others = rng.dirichlet([0.5, 0.5, 0.5], size=200)
    corners = np.concatenate([a, b, c])
    d = np.linalg.norm(weights @ corners - p)
    assert d <= np.linalg.norm(others @ corners - p, axis=1).min() * (1 + 1e-9)


def test_triangles_without_area():
    # A needle of length 2 along x, and a point.
    a = np.array([[0.0, 0, 0], [1, 1, 1]])
    b = np.array([[1.0, 0, 0], [1, 1, 1]])
    c = np.array([[2.0, 0, 0], [1, 1, 1]])
    P = np.array([[1.5, 3, 0], [1, 1, 4]])
    weights = closest_in_triangle(P, a, b, c)
    found = np.einsum("ij,ijk->ik", weights, np.stack([a, b, c], axis=1))
    np.testing.assert_allclose(found, [[1.5, 0, 0], [1, 1, 1]], atol=1e-15)


def test_triangles_whose_area_is_rounding():
    # On a line, but for how its points are rounded.
    t = np.random.default_rng(0).uniform(size=(1000, 4, 1))
    a, b, c, p = ((0.1, 0.2, 0.3) + t * (0.3, 0.1, 0.7)).swapaxes(0, 1)
    p = np.clip(p, np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c))
    found = np.einsum("nk,knx->nx", closest_in_triangle(p, a, b, c), np.stack([a, b, c]))
    np.testing.assert_allclose(found, p, atol=1e-15)


def test_closest_points_of_a_sphere_lie_on_its_faces():
    V, F = sphere(1000)
    Q = 1.5 * sphere(333)[0]
    face, weights = ClosestPoints(V, F).find(Q)
    P = np.einsum("ij,ijk->ik", weights, V[F[face]])
    # The hull of 1000 points lies within 1 - cos(edge / 2) of the sphere.
    np.testing.assert_allclose(np.linalg.norm(P, axis=1), 1.0, atol=0.01)
    np.testing.assert_allclose(P, Q / 1.5, atol=0.1)


def test_far_from_the_origin_nothing_is_lost():
    V, F = sphere(1000)
    Q = sphere(333)[0] * 1.01
    near = ClosestPoints(V, F).distances(Q)
    far = ClosestPoints(V + 4096.0, F).distances(Q + 4096.0)
    np.testing.assert_allclose(far, near, atol=1e-7)


def test_samples_are_even_by_area():
    # Two triangles of areas 1 and 3 in planes z = 0 and z = 1.
    V = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [0, 0, 1], [2, 0, 1], [0, 3, 1]])
    F = np.array([[0, 1, 2], [3, 4, 5]])
    P = sample_surface(V, F, 4000, np.random.default_rng(0))
    assert np.count_nonzero(P[:, 2] == 1) == 3000
    # A triangle's mean is its centroid.
    np.testing.assert_allclose(P[P[:, 2] == 0].mean(axis=0), [2 / 3, 1 / 3, 0], atol=0.03)
    np.testing.assert_allclose(P[P[:, 2] == 1].mean(axis=0), [2 / 3, 1, 1], atol=0.04)


@pytest.mark.parametrize(
    "V",
    [
        np.arange(12.0)[:, None] * [1.0, 0.0, 0.0],
        np.repeat([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]], 6, axis=0),
        np.full((12, 3), 7.0),
        np.eye(3)[np.arange(12) % 3] * [1.0, 1e-170, 1e-170],
    ],
    ids=["a line", "two points", "one point", "too thin for its area to be a number"],
)
def test_a_surface_without_area_is_sampled_by_faces(V):
    F = np.arange(12).reshape(4, 3)
    with np.errstate(all="raise", under="ignore"):
        P = sample_surface(V, F, 1000, np.random.default_rng(0))
    assert P.min() >= V.min() - 1e-12
    assert P.max() <= V.max() + 1e-12
    found = np.abs(V[F].mean(axis=(0, 1)) - P.mean(axis=0)).max()
    assert found < 0.05 * max(float(np.ptp(V)), 1e-9)


def test_walks_over_a_ball_end_where_it_is_closest():
    V, F = icosphere(3)
    # A few triangles away, and outside: seen from within, a ball of flat triangles has many
    # points that are closer than all around them.
    Q = 1.2 * normalized(V[F[:, 0]] + 0.2 * np.random.default_rng(2).normal(size=F.shape))
    near, everywhere = np.arange(len(F)), np.full(len(F), np.inf)
    surface = ClosestPoints(V, F)
    wanted, found = surface.faces(Q), surface.faces_near(Q, near, everywhere)
    assert np.mean(found == near) < 0.5
    far = [np.linalg.norm(surface.points_in(face, Q) - Q, axis=1) for face in (wanted, found)]
    np.testing.assert_allclose(*far, atol=1e-12)


def test_walks_that_end_too_far_away_are_searched_instead():
    # A roof, and points below it: on each side, one point is closer than all around it.
    V = np.array([[0.0, 0, 0], [0, 1, 0], [-1, 0.5, -1], [1, 0.5, -1]])
    roof = ClosestPoints(V, np.array([[0, 1, 2], [1, 0, 3]]))
    below, other = np.array([[-0.1, 0.5, -0.3], [0.1, 0.5, -0.3]]), np.array([1, 0])
    far = 0.4 / np.sqrt(2.0)
    np.testing.assert_array_equal(roof.faces_near(below, other, np.full(2, 1.01 * far)), other)
    np.testing.assert_array_equal(roof.faces_near(below, other, np.full(2, 0.99 * far)), [0, 1])


def test_walks_stay_on_their_sheet_but_do_not_end_at_its_border():
    V, F = plane(5)
    step, far = np.ptp(V, axis=0) * [1.0, 0.0, 0.0], [0.0, 0.0, 0.1]
    # Two halves side by side, and a sheet over the first.
    surface = ClosestPoints(
        np.concatenate([V, V + step, V + far]),
        np.concatenate([F, F + len(V), F + 2 * len(V)]),
    )
    inside = V[F].mean(axis=1)
    start, everywhere = np.arange(len(F)), np.full(len(F), np.inf)
    found = surface.faces_near(inside + np.multiply(0.9, far), start, everywhere)
    np.testing.assert_array_equal(found, start)
    np.testing.assert_array_equal(
        surface.faces_near(inside + step, start, everywhere), start + len(F)
    )
