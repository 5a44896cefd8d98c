"""Which word an anchor takes: told by its bulk, which a copy shows too."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from meshmark.arrays import FloatArray, IntArray
from meshmark_plugins.schemes.apex.anchors.geodesic_field import DISC_RADIUS
from meshmark_plugins.schemes.apex.chips.radial_histogram import Profiles

# Words are listed by bulk, in steps of its logarithm, from the least there could be.
N_WORDS, STEP, LEAST_BULK = 96, 0.07, 0.001


def bulk(profiles: Profiles, width: float, scales: FloatArray) -> FloatArray:
    """Area within `DISC_RADIUS` of each anchor, in squared units, (G, C) float64.

    It tells a nose from a hoof from a tail, hardly changes as the body moves, and knows nothing of
    what was cut away farther off.

    Parameters
    ----------
    profiles : Profiles
        About C anchors, in cells of distances in root areas.
    width : float
        Width of a bin.
    scales : (G,) float64
        Factor that turns distances into units.
    """
    area = profiles.area_within(DISC_RADIUS / (width * scales))
    return area * scales[:, None] ** 2


def place_of(bulk: FloatArray) -> FloatArray:
    """Place in the list of words that a bulk stands for; between two words mostly."""
    place = np.log(np.maximum(bulk, LEAST_BULK) / LEAST_BULK) / STEP
    return np.minimum(place, N_WORDS - 1.0)


def choose_words(places: FloatArray) -> IntArray:
    """Give each anchor (C,) the word nearest to its place, no word twice, (C,) int."""
    away = np.abs(places[:, None] - np.arange(N_WORDS))
    return linear_sum_assignment(away)[1].astype(np.int64)
