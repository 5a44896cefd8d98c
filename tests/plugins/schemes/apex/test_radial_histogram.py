"""Radial histograms of surfaces where they are known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.mesh.topology import boundary_edges
from meshmark.testing.meshes import icosphere
from meshmark_plugins.schemes.apex.anchors.geodesic_field import geodesic_fields
from meshmark_plugins.schemes.apex.chips.radial_histogram import CELLS_PER_BIN, radial_histograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import cells_needed
from meshmark_plugins.schemes.apex.chips.soft_chips import measure_chips
from meshmark_plugins.schemes.apex.chips.whitening import whitening_weights

K, WIDTH = 14, 0.045
B = cells_needed(K, WIDTH)
# Radius of a sphere of area 1.
UNIT = 1.0 / np.sqrt(4.0 * np.pi)


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
