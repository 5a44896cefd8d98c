"""Readings: chips of radial profiles under every hypothesis of scale and offset."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from meshmark_plugins.schemes.apex.profile import CELLS, Profiles

FloatArray = NDArray[np.float64]

# Cropping and noise change a surface's area, and with it the unit of distance.
SCALES: FloatArray = np.round(np.arange(0.74, 1.081, 0.02), 2)
# Simplification and smoothing move a tip, and with it where distance begins; in bins.
OFFSETS: FloatArray = np.array([-0.3, -0.15, 0.0, 0.15, 0.3])
# How fast belief falls with the distance of a hypothesis from "nothing changed", and the share
# of it that does not fall: a third of a mesh cut away changes the scale by a sixth.
SCALE_SPREAD, OFFSET_SPREAD = 0.03, 0.15
ANYTHING = 0.3

# Bins with fewer vertices than this (their number weighed as Kish does) are erasures.
LEAST_COUNT = 12.0
# Softening: a chip's evidence is tanh(GAIN s / (STRAY^2 + HOST / n)). HOST / n is the variance
# that sin has for n vertices strewn at random, STRAY what attacks add whatever n is.
GAIN, STRAY, HOST = 0.08, 0.05, 0.5


@dataclass(frozen=True, eq=False)
class Hypotheses:
    """The grid of scales and offsets, with the share of belief in each.

    Parameters
    ----------
    scale, offset : (R,) float64
        Of the distance, and to it, in bins. The first is (1, 0).
    log_prior : (R,) float64
        Natural logarithm of the belief; the exponentials sum to 1.
    """

    scale: FloatArray
    offset: FloatArray
    log_prior: FloatArray


@lru_cache(maxsize=1)
def hypotheses() -> Hypotheses:
    """Return the grid, the most believed first."""
    scale, offset = (axis.ravel() for axis in np.meshgrid(SCALES, OFFSETS, indexing="ij"))
    near = np.exp(-np.abs(SCALES - 1.0) / SCALE_SPREAD)
    of_scale = (1.0 - ANYTHING) * near / near.sum() + ANYTHING / len(SCALES)
    of_offset = np.exp(-np.abs(OFFSETS) / OFFSET_SPREAD)
    belief = (of_scale[:, None] * of_offset / of_offset.sum()).ravel()
    away = np.abs(scale - 1.0) / SCALE_SPREAD + np.abs(offset) / OFFSET_SPREAD
    order = np.argsort(away, kind="stable")
    return Hypotheses(scale[order], offset[order], np.log(belief[order]))


def cells_needed(n_bins: int) -> int:
    """Count the cells a profile must have for every hypothesis to see all of its bins."""
    return int(np.ceil((n_bins + 1 - OFFSETS.min()) / SCALES.min())) * CELLS


@lru_cache(maxsize=4)
def _masks(n_bins: int) -> tuple[FloatArray, FloatArray]:
    """Which cell counts for which bin, and with which phase: two arrays (B, R, K)."""
    grid = hypotheses()
    centre = (np.arange(cells_needed(n_bins)) + 0.5) / CELLS
    # The first bin's width about the anchor stays unused: there, vertices must not move.
    x = centre[:, None] * grid.scale + grid.offset - 1.0
    k = np.floor(x)
    inside = (k[..., None] == np.arange(n_bins)).astype(np.float64)
    return inside, inside * phase(x - k)[..., None]


def phase(u: FloatArray) -> FloatArray:
    """Compute what a vertex at place u of its bin, in [0, 1), adds to the bin's chip.

    It vanishes at both ends: a vertex that crosses from one bin into the next does not count
    differently all of a sudden.
    """
    value: FloatArray = -np.sin(2.0 * np.pi * u)
    return value


def measure(
    profiles: Profiles, n_bins: int, n_readings: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Measure the chips under every hypothesis.

    Parameters
    ----------
    profiles : Profiles
        With `cells_needed(n_bins)` cells.
    n_bins : int
        K.
    n_readings : int, optional
        Only the first so many hypotheses; with 1, that nothing changed.

    Returns
    -------
    s : (R, C, K) float64
        Weighted mean phase of the vertices in each bin, less that of the surface.
    n : (R, C, K) float64
        How many vertices that mean is worth.
    """
    inside, phased = (mask[:, :n_readings] for mask in _masks(n_bins))
    weight, square, area = (
        np.einsum("cb,brk->rck", values, inside, optimize=True)
        for values in (profiles.weight, profiles.square, profiles.area)
    )
    tilt = np.einsum("cb,brk->rck", profiles.weight, phased, optimize=True)
    even = np.einsum("cb,brk->rck", profiles.area, phased, optimize=True)
    s = _ratio(tilt, weight) - _ratio(even, area)
    return s, _ratio(weight**2, square)


def soften(s: FloatArray, n: FloatArray) -> FloatArray:
    """Turn chips into evidence in (-1, 1); 0 where too few vertices speak."""
    noise = STRAY**2 + HOST / np.maximum(n, 1.0)
    evidence: FloatArray = np.where(n >= LEAST_COUNT, np.tanh(GAIN * s / noise), 0.0)
    return evidence


def _ratio(a: FloatArray, b: FloatArray) -> FloatArray:
    ratio: FloatArray = np.divide(a, b, out=np.zeros_like(a), where=b > 0.0)
    return ratio
