"""Chips: measured from given histograms, made evidence of, and how they follow moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import normalized, vertex_normals
from meshmark.testing.meshes import bumpy_sphere, icosphere
from meshmark_plugins.schemes.apex.anchors.geodesic_field import geodesic_fields
from meshmark_plugins.schemes.apex.chips.radial_histogram import (
    CELLS_PER_BIN,
    RadialHistograms,
    radial_histograms,
)
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import (
    OFFSETS,
    ScaleHypotheses,
    cells_needed,
)
from meshmark_plugins.schemes.apex.chips.soft_chips import (
    ATTACK_NOISE,
    CUT_BORDER_WIDTHS,
    CUT_RELIABILITY,
    DETOUR_BORDER_WIDTHS,
    MIN_VERTEX_COUNT,
    SINE_VARIANCE,
    SOFT_GAIN,
    border_reliability,
    chip_kernel,
    measure_chips,
    soften,
)
from meshmark_plugins.schemes.apex.chips.unit_series import nearest_residue, relative_units
from meshmark_plugins.schemes.apex.chips.whitening import whitening_weights
from meshmark_plugins.schemes.apex.marking.gradients import (
    chip_jacobian,
    distance_directions,
    slide_field,
)

K, WIDTH = 14, 0.045
B = cells_needed(K, WIDTH)
# Nothing was changed: one scale, one offset.
PLAIN = np.ones(1), np.zeros(1)
SCALES = np.array([1.0, 0.62, 0.8, 0.98, 1.2])
# Where the first bin begins: the width of one about the anchor stays unused.
FIRST = CELLS_PER_BIN


def histogram_at(cells, weight=1.0, square=1.0, area=0.0):
    """One anchor's histogram with vertices in some cells, over a surface of even area."""
    w, q = np.zeros((2, 1, B))
    w[0, cells], q[0, cells] = weight, square
    return RadialHistograms(w, q, np.full((1, B), area), np.zeros((1, B)))


def test_the_kernel_vanishes_at_both_ends_and_has_no_mean():
    np.testing.assert_allclose(
        chip_kernel(np.array([0.0, 0.25, 0.5, 0.75, 1.0])), [0, -1, 0, 1, 0], atol=1e-15
    )
    assert chip_kernel((np.arange(CELLS_PER_BIN) + 0.5) / CELLS_PER_BIN).sum() == pytest.approx(
        0.0, abs=1e-12
    )


@pytest.mark.parametrize("k", [0, 5, K - 1])
def test_vertices_at_one_place_of_a_bin_give_the_kernel_there(k):
    for cell in range(CELLS_PER_BIN):
        s, n = measure_chips(
            histogram_at(FIRST + k * CELLS_PER_BIN + cell, weight=5.0, square=2.5), K, *PLAIN
        )
        wanted = np.zeros(K)
        wanted[k] = -np.sin(2.0 * np.pi * (cell + 0.5) / CELLS_PER_BIN)
        np.testing.assert_allclose(s[0, 0], wanted, atol=1e-12)
        # By Kish: (sum w)^2 / sum w^2.
        np.testing.assert_allclose(n[0, 0], np.where(wanted != 0.0, 10.0, 0.0))


def test_the_mean_over_the_surface_is_taken_off():
    histograms = histogram_at(FIRST + 3 * CELLS_PER_BIN + 7)
    even = measure_chips(replace(histograms, area=np.ones((1, B))), K, *PLAIN)[0]
    np.testing.assert_allclose(even, measure_chips(histograms, K, *PLAIN)[0], atol=1e-12)
    same = replace(histograms, area=4.0 * histograms.weight)
    np.testing.assert_allclose(measure_chips(same, K, *PLAIN)[0], 0.0, atol=1e-12)


def test_the_anchor_s_own_bin_and_what_lies_beyond_the_last_count_for_nothing():
    outside = np.concatenate([np.arange(FIRST), np.arange(FIRST + K * CELLS_PER_BIN, B)])
    s, n = measure_chips(histogram_at(outside), K, *PLAIN)
    assert not s.any()
    assert not n.any()


def test_a_chip_that_the_border_runs_through_is_believed_less():
    histograms = histogram_at(np.arange(B))
    assert np.all(border_reliability(histograms, K, WIDTH, *PLAIN) == 1.0)
    for k in (0, 5, K - 1):
        bin_k = slice(FIRST + k * CELLS_PER_BIN, FIRST + (k + 1) * CELLS_PER_BIN)
        for length, cut in ((2.0, True), (0.3, False)):
            border = np.zeros((1, B))
            border[0, bin_k] = length * WIDTH / CELLS_PER_BIN
            factors = border_reliability(replace(histograms, border=border), K, WIDTH, *PLAIN)[0, 0]
            np.testing.assert_array_equal(factors != 1.0, cut & (np.arange(K) == k))
            assert np.all((factors > 0.0) & (factors <= 1.0))


def test_how_far_chips_are_believed_follows_the_hypotheses():
    rng = np.random.default_rng(0)
    border = np.zeros((1, B))
    border[0, rng.choice(B, 20)] = 0.4 * WIDTH
    found = border_reliability(replace(histogram_at([]), border=border), K, WIDTH, SCALES, OFFSETS)[
        :, 0
    ]
    middles = (np.arange(B) + 0.5) / CELLS_PER_BIN
    for r, factors in enumerate(found):
        scale, offset = SCALES[r // len(OFFSETS)], OFFSETS[r % len(OFFSETS)]
        x = np.floor(middles * scale + offset - 1.0)
        length = np.array([scale * border[0, x == k].sum() for k in range(K)])
        nearer = np.cumsum(length) - length
        clear = np.abs(length - CUT_BORDER_WIDTHS * WIDTH) > 1e-9
        clear &= np.abs(nearer - DETOUR_BORDER_WIDTHS * WIDTH) > 1e-9
        wanted = (length >= CUT_BORDER_WIDTHS * WIDTH) | (nearer >= DETOUR_BORDER_WIDTHS * WIDTH)
        np.testing.assert_array_equal((factors < 1.0)[clear], wanted[clear])


def test_chips_behind_a_long_cut_are_believed_less_and_behind_a_short_one_not():
    histograms = histogram_at(np.arange(B))
    for length, spoilt in ((1.8, False), (2.2, True)):
        border = np.zeros((1, B))
        # A cut through two bins, no more of it in any of them than any cut leaves there.
        border[0, FIRST + 4 * CELLS_PER_BIN : FIRST + 6 * CELLS_PER_BIN] = (
            length * WIDTH / CELLS_PER_BIN
        )
        factors = border_reliability(replace(histograms, border=border), K, WIDTH, *PLAIN)[0, 0]
        np.testing.assert_array_equal(factors[:4], 1.0)
        np.testing.assert_array_equal(factors[4:6], CUT_RELIABILITY)
        np.testing.assert_array_equal(factors[6:], CUT_RELIABILITY if spoilt else 1.0)


def read(x, w):
    """Chips of vertices of weights w at distances x, in bins."""
    cells = (x * CELLS_PER_BIN).astype(int)
    weight, square = (np.bincount(cells, v, B)[None, :B] for v in (w, w**2))
    nothing = np.zeros((1, B))
    return measure_chips(RadialHistograms(weight, square, nothing, nothing), K, SCALES, OFFSETS)[0][
        :, 0
    ]


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), r=st.integers(0, len(SCALES) * len(OFFSETS) - 1))
def test_a_histogram_that_was_stretched_is_read_by_the_hypothesis_of_that_scale(seed, r):
    rng = np.random.default_rng(seed)
    x = np.linspace(0.5, K + 1.5, 20_000)
    lean = rng.choice([-0.5, 0.5], K + 2)[x.astype(int)]
    w = 1.0 - lean * np.sin(2.0 * np.pi * x)
    scale, offset = SCALES[r // len(OFFSETS)], OFFSETS[r % len(OFFSETS)]
    true = read(x, w)[0]
    np.testing.assert_allclose(np.abs(true), 0.25, atol=0.001)
    stretched = read((x - offset) / scale, w)
    np.testing.assert_allclose(stretched[r], true, atol=0.01)
    if scale < 0.95:
        assert np.abs(stretched[0] - true).max() > 0.1


def test_every_hypothesis_sees_every_bin_in_full():
    scales = ScaleHypotheses.about(2.0).scales(2.0)
    _, n = measure_chips(histogram_at(np.arange(B)), K, scales, OFFSETS)
    assert n.shape == (len(scales) * len(OFFSETS), 1, K)
    # A bin of scale r is 1 / r bins long.
    assert np.abs(n[:, 0] - (CELLS_PER_BIN / np.repeat(scales, len(OFFSETS)))[:, None]).max() <= 1.0


def test_many_hypotheses_are_measured_as_one_by_one():
    histograms = histogram_at(np.arange(0, B, 3), area=0.2)
    every = measure_chips(histograms, K, SCALES, OFFSETS)
    for r, (scale, offset) in enumerate((a, b) for a in SCALES for b in OFFSETS):
        alone = measure_chips(histograms, K, np.array([scale]), np.array([offset]))
        np.testing.assert_allclose(every[0][r], alone[0][0], atol=1e-12)
        np.testing.assert_allclose(every[1][r], alone[1][0], atol=1e-12)


@pytest.mark.parametrize("root_area", [0.013, 1.0, 2.27, 640.0])
def test_belief_is_shared_out_and_a_crop_keeps_the_unit_in_question(root_area):
    hypotheses = ScaleHypotheses.about(root_area)
    assert np.exp(hypotheses.log_prior).sum() == pytest.approx(1.0, abs=1e-12)
    assert len(hypotheses.log_prior) == len(hypotheses.residue) * len(OFFSETS)
    # The unit of a whole mesh, and what a third of it, or two, cut away makes of it.
    residue = np.array([nearest_residue(root_area)])
    unit = relative_units(root_area, residue)[0] * root_area
    for left in (1.0, 2 / 3, 0.4):
        rest = root_area * np.sqrt(left)
        hypotheses = ScaleHypotheses.about(rest)
        right = np.abs(hypotheses.scales(rest) - rest / unit) < 1e-9
        assert right.any()
        assert np.exp(hypotheses.log_scale_prior[right]).max() > 0.005


def test_evidence_by_hand():
    n = np.array([100.0, MIN_VERTEX_COUNT, np.nextafter(MIN_VERTEX_COUNT, 0.0), 0.0])
    evidence = soften(np.full(4, 0.2), n)
    wanted = [np.tanh(SOFT_GAIN * 0.2 / (ATTACK_NOISE**2 + SINE_VARIANCE / m)) for m in n[:2]]
    np.testing.assert_allclose(evidence, [*wanted, 0.0, 0.0])
    assert evidence[0] == pytest.approx(0.9723, abs=1e-4)


@given(st.floats(-1.0, 1.0), st.floats(0.0, 1e6))
def test_evidence_is_odd_and_bounded_and_grows_with_the_chip_and_the_count(s, n):
    evidence = soften(np.array([s, -s, 0.5 * s, s]), np.array([n, n, n, 2.0 * n]))
    assert evidence[0] == -evidence[1]
    assert abs(evidence[2]) <= abs(evidence[0]) <= abs(evidence[3]) <= 1.0


# Gradients of chips.


@pytest.fixture(scope="module")
def horned():
    V, F = bumpy_sphere(5, np.array([[1, 0.2, 0.1], [-0.3, 1, 0.2]]), height=0.4, width=0.5)
    tips = [int(np.argmax(V @ axis)) for axis in ([1, 0.2, 0.1], [-0.3, 1, 0.2])]
    (field,) = geodesic_fields(V, F, np.array(tips))
    weights = whitening_weights(field, WIDTH)
    J = chip_jacobian(field, distance_directions(field), weights, WIDTH, K, len(V))
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
    moved = slide_field(field, down)
    np.testing.assert_array_equal(moved.V, down)
    np.testing.assert_allclose((moved.H - field.H)[0] * field.length_scale, way, atol=0.0005)
    np.testing.assert_allclose(
        slide_field(field, aside).H, field.H, atol=0.0005 / field.length_scale
    )
    np.testing.assert_array_equal(slide_field(field, V).H, field.H)


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
