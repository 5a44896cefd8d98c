"""How distances and chips follow moves of vertices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_matrix, eye_array

from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import normalized, vertex_normals
from meshmark.testing.meshes import bumpy_sphere, icosphere
from meshmark_plugins.schemes.apex.anchors.geodesic_field import geodesic_fields
from meshmark_plugins.schemes.apex.chips.gradients import distance_directions, vertex_chips
from meshmark_plugins.schemes.apex.chips.radial_histogram import radial_histograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import cells_needed
from meshmark_plugins.schemes.apex.chips.soft_chips import chip_kernel, measure_chips
from meshmark_plugins.schemes.apex.chips.whitening import whitening_weights

K, WIDTH = 14, 0.045
B = cells_needed(K, WIDTH)
# Nothing was changed: one scale, one offset.
PLAIN = np.ones(1), np.zeros(1)


@pytest.fixture(scope="module")
def horned():
    V, F = bumpy_sphere(5, np.array([[1, 0.2, 0.1], [-0.3, 1, 0.2]]), height=0.4, width=0.5)
    tips = [int(np.argmax(V @ axis)) for axis in ([1, 0.2, 0.1], [-0.3, 1, 0.2])]
    (field,) = geodesic_fields(V, F, np.array(tips))
    weights = whitening_weights(field, WIDTH)
    slopes = distance_directions(field) / field.length_scale
    J = vertex_chips(field.H, slopes, csr_matrix(eye_array(len(V))), weights, WIDTH, K)[2]
    return V, F, field, weights, J


def chips(field, weights):
    """Weighted means of the kernel, without the rounding to cells."""
    x = field.H / WIDTH - 1.0
    k = np.floor(x).astype(int)
    value = np.zeros((len(x), K))
    for row, bins, place in zip(value, k, x - k, strict=True):
        inside = (bins >= 0) & (bins < K)
        moment = np.bincount(bins[inside], (weights * chip_kernel(place))[inside], K)
        row[:] = moment / np.bincount(bins[inside], weights[inside], K)
    return value


def test_distance_grows_along_meridians_of_a_sphere():
    V, F = icosphere(4)
    (field,) = geodesic_fields(V, F, np.array([0]))
    south = normalized(V * V[:, [2]] - [0.0, 0.0, 1.0])
    colatitude = np.arccos(np.clip(V[:, 2], -1.0, 1.0))
    middle = (colatitude > 0.2) & (colatitude < np.pi - 0.2)
    cosine = np.einsum("ij,ij->i", distance_directions(field)[0], south)
    assert cosine[middle].min() > 0.98
    assert np.linalg.norm(distance_directions(field)[0], axis=1).max() <= 1.0 + 1e-12
    # At the anchor itself it grows all around: what is left is the mesh's own bend there.
    assert np.linalg.norm(distance_directions(field)[0, 0]) < 0.05


def rings(field, rng, longest):
    """Slide the vertices of each bin up or down the distance from the first anchor, in bins."""
    x = field.H[0] / WIDTH
    push = rng.uniform(-1.0, 1.0, 1 + int(x.max()))[x.astype(int)] * np.sin(np.pi * x) ** 2
    return longest * WIDTH * field.length_scale * push[:, None] * distance_directions(field)[0]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_chips_follow_moves_as_their_gradients_foretell(horned, seed):
    V, F, field, weights, J = horned
    d = rings(field, np.random.default_rng(seed), longest=0.05)
    after = ClosestPoints(V, F).points(V + d)
    foretold = (J @ (after - V).ravel())[:K]
    (moved,) = geodesic_fields(after, F, field.anchors)
    change = (chips(moved, weights) - chips(field, weights))[0]
    assert np.abs(foretold).mean() > 0.02
    np.testing.assert_allclose(change, foretold, atol=0.05 * np.abs(foretold).max())
    # As detection measures them, whitened anew, they follow nearly as well, but less far.
    before, now = (
        measure_chips(radial_histograms(n, whitening_weights(n, WIDTH), WIDTH, B), K, *PLAIN)[0][
            0, 0
        ]
        for n in (field, moved)
    )
    assert np.corrcoef(foretold, now - before)[0, 1] > 0.98
    assert 0.75 < foretold @ (now - before) / (foretold @ foretold) < 1.0


def test_distances_slide_along_with_vertices():
    V, F = icosphere(4)
    (field,) = geodesic_fields(V, F, np.array([0]))
    colatitude = np.arccos(np.clip(V[:, 2], -1.0, 1.0))
    middle = (colatitude > 0.3) & (colatitude < np.pi - 0.3)
    south = normalized(V * V[:, [2]] - [0.0, 0.0, 1.0])
    east = np.cross(south, V)
    way = np.where(middle, np.random.default_rng(0).uniform(-0.02, 0.02, len(V)), 0.0)
    down, aside = (normalized(V + way[:, None] * along) for along in (south, east))
    (directions,) = distance_directions(field)
    np.testing.assert_allclose(np.vecdot(directions, down - V), way, atol=0.0005)
    np.testing.assert_allclose(np.vecdot(directions, aside - V), 0.0, atol=0.0005)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_chips_follow_random_waves_of_moves(horned, seed):
    V, F, field, weights, J = horned
    rng = np.random.default_rng(seed)
    length = WIDTH * field.length_scale
    waves = 2.0 * np.pi / length * normalized(rng.normal(size=(12, 3)))
    d = np.cos(V @ waves.T + rng.uniform(0, 2 * np.pi, 12)) @ rng.normal(size=(12, 3))
    n = vertex_normals(V, F)
    d -= np.einsum("ij,ij->i", d, n)[:, None] * n
    d *= 0.1 * length / np.linalg.norm(d, axis=1).max()
    after = ClosestPoints(V, F).points(V + d)
    (moved,) = geodesic_fields(after, F, field.anchors)
    change = chips(moved, weights) - chips(field, weights)
    foretold = J @ (after - V).ravel()
    assert np.corrcoef(foretold, change.ravel())[0, 1] > 0.93


def test_moves_across_the_distance_or_far_away_change_no_chip(horned):
    V, F, field, _, J = horned
    d = np.cross(distance_directions(field)[0], vertex_normals(V, F))
    along = J[:K] @ distance_directions(field)[0].ravel()
    assert np.abs(J[:K] @ d.ravel()).max() < 1e-9 * np.abs(along).max()
    beyond = field.H[0] > (K + 1) * WIDTH
    assert beyond.any()
    assert not np.any(J[:K] @ np.repeat(beyond, 3))
