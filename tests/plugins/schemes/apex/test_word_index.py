"""Words told by the disc areas of their anchors."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.testing.meshes import icosphere
from meshmark_plugins.schemes.apex.anchors.geodesic_field import DISC_RADIUS, geodesic_fields
from meshmark_plugins.schemes.apex.chips.radial_histogram import radial_histograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import cells_needed
from meshmark_plugins.schemes.apex.chips.whitening import whitening_weights
from meshmark_plugins.schemes.apex.chips.word_index import (
    LOG_AREA_STEP,
    N_WORDS,
    choose_words,
    geodesic_disc_areas,
    word_position,
)


def test_a_disc_area_is_the_area_about_an_anchor_in_squared_units():
    V, F = icosphere(5)
    (field,) = geodesic_fields(V, F, np.array([0]))
    histograms = radial_histograms(
        field, whitening_weights(field, 0.04), 0.04, cells_needed(16, 0.04)
    )
    scales = np.array([1.0, 0.8])
    found = geodesic_disc_areas(histograms, 0.04, scales)[:, 0]
    # Archimedes: a cap of height h has the area 2 pi r h; root area 1 is a radius of .2821.
    r = 1.0 / np.sqrt(4.0 * np.pi)
    cap = 2.0 * np.pi * r**2 * (1.0 - np.cos(DISC_RADIUS / scales / r)) * scales**2
    np.testing.assert_allclose(found, cap, rtol=0.01)


def test_positions_go_with_the_logarithm_of_the_disc_area_and_words_are_the_nearest():
    positions = word_position(np.array([0.04, 0.04 * np.exp(LOG_AREA_STEP), 0.0, 1e9]))
    assert positions[1] - positions[0] == pytest.approx(1.0)
    assert positions[2] == 0.0
    assert positions[3] == N_WORDS - 1.0
    assert choose_words(np.array([20.2, 7.9, 33.4])).tolist() == [20, 8, 33]
    crowded = choose_words(np.array([20.0, 20.0, 20.1, 20.2]))
    assert len(set(crowded.tolist())) == 4
    assert np.abs(crowded - 20).max() <= 2
