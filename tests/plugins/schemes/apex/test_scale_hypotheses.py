"""Hypotheses of the unit a copy was marked in, and their priors."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark_plugins.schemes.apex.chips.radial_histogram import CELLS_PER_BIN, RadialHistograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import (
    OFFSETS,
    ScaleHypotheses,
    cells_needed,
)
from meshmark_plugins.schemes.apex.chips.soft_chips import measure_chips
from meshmark_plugins.schemes.apex.chips.unit_series import nearest_residue, relative_units

K, WIDTH = 14, 0.045
B = cells_needed(K, WIDTH)


def histogram_at(cells, weight=1.0, square=1.0, area=0.0):
    """One anchor's histogram with vertices in some cells, over a surface of even area."""
    w, q = np.zeros((2, 1, B))
    w[0, cells], q[0, cells] = weight, square
    return RadialHistograms(w, q, np.full((1, B), area), np.zeros((1, B)))


def test_every_hypothesis_sees_every_bin_in_full():
    scales = ScaleHypotheses.about(2.0).scales(2.0)
    _, n = measure_chips(histogram_at(np.arange(B)), K, scales, OFFSETS)
    assert n.shape == (len(scales) * len(OFFSETS), 1, K)
    # A bin of scale r is 1 / r bins long.
    assert np.abs(n[:, 0] - (CELLS_PER_BIN / np.repeat(scales, len(OFFSETS)))[:, None]).max() <= 1.0


@pytest.mark.parametrize("root_area", [0.013, 1.0, 2.27, 640.0])
def test_the_prior_is_shared_out_and_a_crop_keeps_the_unit_in_question(root_area):
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
