"""Whitening weights, and the Laplacian behind them, where densities are known."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.geometry import face_areas, vertex_areas
from meshmark.mesh.laplacian import (
    MAX_COTANGENT,
    cotangent_weights,
    stiffness_matrix,
)
from meshmark.testing.meshes import icosphere, plane, revolution, torus
from meshmark_plugins.schemes.apex.chips.whitening import inverse_density

K, WIDTH = 14, 0.045


def root_area(V, F):
    return float(np.sqrt(face_areas(V, F).sum()))


def test_laplacian_of_a_plane_measures_slopes():
    V, F = plane(9, side=3.0)
    L = stiffness_matrix(F, cotangent_weights(V, F), len(V))
    # |grad (2 x - y)|^2 = 5 over an area of 9.
    f = 2.0 * V[:, 0] - V[:, 1]
    assert f @ L @ f == pytest.approx(45.0)
    np.testing.assert_allclose(L @ np.ones(len(V)), 0.0, atol=1e-12)
    np.testing.assert_array_equal(L.toarray(), L.toarray().T)


def test_slivers_and_triangles_without_area_get_bounded_weights():
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0], [0.5, 0, 0], [0, 0, 0]])
    F = np.array([[0, 1, 2], [0, 1, 3], [0, 4, 1], [4, 4, 0]])
    weights = cotangent_weights(V, F)
    assert weights.min() >= 0.0
    assert weights.max() <= MAX_COTANGENT
    # Right angles weigh nothing, half of them a half.
    V, F = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
    np.testing.assert_allclose(cotangent_weights(V, F), [[0.0, 0.5, 0.5]], atol=1e-15)


def test_weights_of_an_even_mesh_are_even_and_sum_to_one():
    V, F = icosphere(5)
    weights = inverse_density(V, F, root_area(V, F), WIDTH / 2.0)
    assert weights.sum() == pytest.approx(1.0, abs=0.005)
    # An icosphere's vertex areas differ by half; evened out over the length, they do by less.
    areas = vertex_areas(V, F)
    assert areas.max() / areas.min() > 1.5
    np.testing.assert_allclose(weights * len(V), 1.0, atol=0.15)


def test_weights_on_a_torus_follow_the_area_between_its_meridians():
    V, F = torus(160, 64)
    weights = inverse_density(V, F, root_area(V, F), WIDTH / 2.0)
    assert weights.sum() == pytest.approx(1.0, abs=0.005)
    np.testing.assert_allclose(weights * len(V), np.hypot(V[:, 0], V[:, 1]), rtol=0.04)


def test_twice_the_density_halves_the_weight_over_the_length_asked_for():
    # Rings of a tube are twice as dense above z = 2.
    n = 60
    z = np.concatenate([np.linspace(0.0, 2.0, 41)[:-1], np.linspace(2.0, 4.0, 81)])
    V, F = revolution(np.full(len(z), 0.6), z, n)
    length = WIDTH / 2.0 * root_area(V, F)
    weights = inverse_density(V, F, root_area(V, F), WIDTH / 2.0)[:-2].reshape(-1, n)
    # The density, from 1 to 2, diffused along the tube.
    x = (z - 2.0) / length
    density = 1.5 + np.sign(x) * 0.5 * (1.0 - np.exp(-np.abs(x)))
    ring = weights.mean(axis=1) / weights[np.searchsorted(z, 3.0)].mean()
    middle = np.abs(z - 2.0) < 1.0
    np.testing.assert_allclose(ring[middle], (2.0 / density)[middle], rtol=0.01)
    assert np.ptp(weights, axis=1).max() < 1e-3 * weights.min()


def test_a_vertex_without_area_gets_a_weight_of_its_own():
    V, F = plane(11)
    twin = np.concatenate([V, V[[60]]])
    G = np.concatenate([F, [[60, 121, 61]]])
    weights = inverse_density(twin, G, 1.0, WIDTH)
    assert np.all(np.isfinite(weights))
    assert weights.min() > 0
    # Twins share what one had: no cluster counts for more than the surface it stands on.
    alone = inverse_density(V, F, 1.0, WIDTH)
    assert weights[[60, 121]].sum() < 2.0 * alone[60]
