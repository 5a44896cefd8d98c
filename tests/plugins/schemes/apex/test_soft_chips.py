"""Chips measured from given histograms, and the soft evidence made of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark_plugins.schemes.apex.chips.radial_histogram import CELLS_PER_BIN, RadialHistograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import OFFSETS, cells_needed
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


def test_many_hypotheses_are_measured_as_one_by_one():
    histograms = histogram_at(np.arange(0, B, 3), area=0.2)
    every = measure_chips(histograms, K, SCALES, OFFSETS)
    for r, (scale, offset) in enumerate((a, b) for a in SCALES for b in OFFSETS):
        alone = measure_chips(histograms, K, np.array([scale]), np.array([offset]))
        np.testing.assert_allclose(every[0][r], alone[0][0], atol=1e-12)
        np.testing.assert_allclose(every[1][r], alone[1][0], atol=1e-12)


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
