"""Which word of the key an anchor takes: told by an area about it that a copy shows, too."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from meshmark.arrays import FloatArray, IntArray
from meshmark_plugins.schemes.apex.anchors.geodesic_field import DISC_RADIUS
from meshmark_plugins.schemes.apex.chips.radial_histogram import RadialHistograms

# Words are listed by disc area, in steps of its logarithm, from the least area there could be.
N_WORDS, LOG_AREA_STEP, MIN_DISC_AREA = 96, 0.07, 0.001


def geodesic_disc_areas(
    histograms: RadialHistograms, width: float, scales: FloatArray
) -> FloatArray:
    """Area within `DISC_RADIUS` of each anchor, in squared units, (G, C) float64.

    It tells a nose from a hoof from a tail, hardly changes as the body moves, and knows nothing of
    what was cut away farther off.

    Parameters
    ----------
    histograms : RadialHistograms
        About C anchors, in cells of distances in root areas.
    width : float
        Width of a bin.
    scales : (G,) float64
        Factor that turns distances into units.
    """
    area = histograms.area_within(DISC_RADIUS / (width * scales))
    return area * scales[:, None] ** 2


def word_position(disc_area: FloatArray) -> FloatArray:
    """Position in the list of words that a disc area stands for; between two words mostly."""
    position = np.log(np.maximum(disc_area, MIN_DISC_AREA) / MIN_DISC_AREA) / LOG_AREA_STEP
    return np.minimum(position, N_WORDS - 1.0)


def choose_words(positions: FloatArray) -> IntArray:
    """Give each anchor (C,) the word nearest to its position, no word twice, (C,) int."""
    gaps = np.abs(positions[:, None] - np.arange(N_WORDS))
    return linear_sum_assignment(gaps)[1].astype(np.int64)
