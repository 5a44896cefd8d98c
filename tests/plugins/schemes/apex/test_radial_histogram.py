"""Distances, densities and radial profiles of surfaces where they are known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.errors import CapacityError
from meshmark.mesh.geometry import face_areas, vertex_areas
from meshmark.mesh.topology import boundary_edges
from meshmark.testing.invariance import moved
from meshmark.testing.meshes import icosphere, plane, revolution, torus
from meshmark_plugins.geodesics.heat import HeatSolver
from meshmark_plugins.schemes.apex.anchors.geodesic_field import geodesic_fields
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances
from meshmark_plugins.schemes.apex.chips.radial_histogram import CELLS_PER_BIN, radial_histograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import cells_needed
from meshmark_plugins.schemes.apex.chips.soft_chips import measure_chips
from meshmark_plugins.schemes.apex.chips.whitening import whitening, whitening_weights
from meshmark_plugins.schemes.apex.linear_algebra.laplacian import (
    MAX_COTANGENT,
    cotangent_weights,
    stiffness,
)

K, WIDTH = 14, 0.045
B = cells_needed(K, WIDTH)
# Radius of a sphere of area 1.
UNIT = 1.0 / np.sqrt(4.0 * np.pi)


def root_area(V, F):
    return float(np.sqrt(face_areas(V, F).sum()))


# Distances.


def test_distances_on_a_sphere_are_arcs_in_units_of_its_root_area():
    V, F = icosphere(5, radius=7.0)
    geodesics = GeodesicDistances(V, F)
    assert geodesics.root_area == pytest.approx(7.0 / UNIT, rel=1e-3)
    poles = np.array([0, 11, 500])
    arcs = np.arccos(np.clip(V[poles] @ V.T / 49.0, -1.0, 1.0)) * UNIT
    # A third of a per cent of the way to the other pole.
    np.testing.assert_allclose(geodesics.from_vertices(poles), arcs, atol=0.0035 * np.pi * UNIT)
    np.testing.assert_array_equal(geodesics.from_vertices(poles)[1], geodesics.from_vertex(11))


def test_distances_hardly_depend_on_how_finely_the_surface_is_meshed():
    coarse, fine = torus(60, 30), torus(120, 60)
    shared = np.arange(120 * 60).reshape(120, 60)[::2, ::2].ravel()
    np.testing.assert_array_equal(fine[0][shared], coarse[0])
    change = (
        GeodesicDistances(*coarse).from_vertex(5)
        - GeodesicDistances(*fine).from_vertex(shared[5])[shared]
    )
    assert np.abs(change).max() < 0.005
    # With a mean edge for the diffusion length, they do.
    usual = HeatSolver(*coarse).distances([5]) - HeatSolver(*fine).distances([shared[5]])[:, shared]
    assert np.abs(usual).max() / GeodesicDistances(*coarse).root_area > 0.02


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_distances_do_not_depend_on_place_or_size(scale):
    V, F = torus(40, 20)
    other = GeodesicDistances(moved(V, scale, np.random.default_rng(1)), F)
    own = GeodesicDistances(V, F)
    assert other.root_area == pytest.approx(scale * own.root_area, rel=1e-12)
    np.testing.assert_allclose(other.from_vertex(3), own.from_vertex(3), rtol=0, atol=1e-9)


def test_a_surface_without_area_has_no_unit_of_distance():
    V, F = plane(4)
    with pytest.raises(CapacityError, match="no area"):
        GeodesicDistances(V * [1, 0, 0], F)


# Density.


def test_laplacian_of_a_plane_measures_slopes():
    V, F = plane(9, side=3.0)
    L = stiffness(F, cotangent_weights(V, F), len(V))
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
    weights = whitening(V, F, root_area(V, F), WIDTH / 2.0)
    assert weights.sum() == pytest.approx(1.0, abs=0.005)
    # An icosphere's vertex areas differ by half; evened out over the length, they do by less.
    areas = vertex_areas(V, F)
    assert areas.max() / areas.min() > 1.5
    np.testing.assert_allclose(weights * len(V), 1.0, atol=0.15)


def test_weights_on_a_torus_follow_the_area_between_its_meridians():
    V, F = torus(160, 64)
    weights = whitening(V, F, root_area(V, F), WIDTH / 2.0)
    assert weights.sum() == pytest.approx(1.0, abs=0.005)
    np.testing.assert_allclose(weights * len(V), np.hypot(V[:, 0], V[:, 1]), rtol=0.04)


def test_twice_the_density_halves_the_weight_over_the_length_asked_for():
    # Rings of a tube are twice as dense above z = 2.
    n = 60
    z = np.concatenate([np.linspace(0.0, 2.0, 41)[:-1], np.linspace(2.0, 4.0, 81)])
    V, F = revolution(np.full(len(z), 0.6), z, n)
    length = WIDTH / 2.0 * root_area(V, F)
    weights = whitening(V, F, root_area(V, F), WIDTH / 2.0)[:-2].reshape(-1, n)
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
    weights = whitening(twin, G, 1.0, WIDTH)
    assert np.all(np.isfinite(weights))
    assert weights.min() > 0
    # Twins share what one had: no cluster counts for more than the surface it stands on.
    alone = whitening(V, F, 1.0, WIDTH)
    assert weights[[60, 121]].sum() < 2.0 * alone[60]


# Histograms.


@pytest.fixture(scope="module")
def ball():
    V, F = icosphere(5)
    (field,) = geodesic_fields(V, F, np.array([0, 5000]))
    return field, whitening_weights(field, WIDTH)


def test_area_within_a_distance_is_that_of_a_cap(ball):
    field, weights = ball
    area = radial_histograms(field, weights, WIDTH, B).area.cumsum(axis=1)
    reach = (np.arange(B) + 1) / CELLS_PER_BIN * WIDTH / UNIT
    cap = 0.5 * (1.0 - np.cos(np.minimum(reach, np.pi)))
    np.testing.assert_allclose(area, [cap, cap], atol=0.005)
    within = radial_histograms(field, weights, WIDTH, B).area_within(np.array([2.0, 9.5]))
    cap = 0.5 * (1.0 - np.cos(np.array([2.0, 9.5]) * WIDTH / UNIT))
    np.testing.assert_allclose(within, np.stack([cap, cap], axis=1), atol=0.005)


def test_all_area_and_all_weights_within_reach_are_counted_once(ball):
    field, weights = ball
    farthest = int(field.H.max() * CELLS_PER_BIN / WIDTH) + 1
    whole = radial_histograms(field, weights, WIDTH, farthest)
    np.testing.assert_allclose(whole.area.sum(axis=1), 1.0)
    np.testing.assert_allclose(whole.weight.sum(axis=1), weights.sum())
    np.testing.assert_allclose(whole.squared_weight.sum(axis=1), (weights**2).sum())
    # And what is farther away is left out, not heaped at the end.
    some = radial_histograms(field, weights, WIDTH, 5 * CELLS_PER_BIN)
    np.testing.assert_array_equal(some.weight, whole.weight[:, : 5 * CELLS_PER_BIN])
    np.testing.assert_array_equal(some.area, whole.area[:, : 5 * CELLS_PER_BIN])
    within = field.H < 5 * WIDTH
    np.testing.assert_allclose(some.weight.sum(axis=1), within @ weights)


@pytest.mark.parametrize("far", [1e18, 1e38, 1e300, np.inf])
def test_what_is_farther_away_than_any_integer_is_left_out(ball, far):
    field, weights = ball
    beyond = field.H > 5 * WIDTH
    distant = replace(field, H=np.where(beyond, far, field.H))
    with np.errstate(all="raise", under="ignore"):
        some = radial_histograms(distant, weights, WIDTH, 5 * CELLS_PER_BIN)
    np.testing.assert_allclose(some.weight.sum(axis=1), ~beyond @ weights)


def test_the_border_lies_where_it_is_and_is_as_long_as_it_is(ball):
    field, weights = ball
    assert not radial_histograms(field, weights, WIDTH, B).border.any()
    # What is left of the ball above a plane has a circle for a border, all at one distance.
    V, F = icosphere(5)
    upper = F[np.all(V[F, 2] > 0.3, axis=1)]
    used, upper = np.unique(upper, return_inverse=True)
    V, top = V[used], int(np.argmax(V[used, 2]))
    (field,) = geodesic_fields(V, upper.reshape(-1, 3), np.array([top]))
    weights = whitening_weights(field, WIDTH)
    border = radial_histograms(field, weights, WIDTH, 40 * CELLS_PER_BIN).border[0]
    rim = boundary_edges(field.component.faces)
    length = np.linalg.norm(field.V[rim[:, 0]] - field.V[rim[:, 1]], axis=1).sum()
    assert border.sum() == pytest.approx(length / field.length_scale)
    where = np.flatnonzero(border) * WIDTH / CELLS_PER_BIN
    angle = np.arccos(field.V[rim[:, 0], 2])
    assert where.min() >= angle.min() / field.length_scale - 2.0 * WIDTH
    assert where.max() <= angle.max() / field.length_scale + 2.0 * WIDTH


def test_chips_of_an_even_mesh_are_small_and_count_its_vertices(ball):
    field, weights = ball
    s, n = measure_chips(radial_histograms(field, weights, WIDTH, B), K, np.ones(1), np.zeros(1))
    assert np.abs(s).max() < 0.1 * 0.2
    count = [np.bincount((H / WIDTH).astype(int), minlength=K + 1)[1 : K + 1] for H in field.H]
    # Equal weights count in full, and unequal ones less.
    np.testing.assert_allclose(n[0], count, rtol=0.02)
    assert np.all(n[0] <= np.array(count) + 1e-9)
