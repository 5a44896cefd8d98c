"""Chips, measured from radial histograms, and the soft evidence that is made of them."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark_plugins.schemes.apex.chips.radial_histogram import CELLS_PER_BIN, RadialHistograms

# Bins with fewer vertices than this (in effect: see `measure_chips`) are erasures.
MIN_VERTEX_COUNT = 12.0
# A chip's evidence is tanh(SOFT_GAIN s / (ATTACK_NOISE^2 + SINE_VARIANCE / n)): the variance of
# the sine of n vertices strewn at random is SINE_VARIANCE / n, and ATTACK_NOISE is the standard
# deviation that attacks add whatever n is.
SOFT_GAIN, ATTACK_NOISE, SINE_VARIANCE = 0.08, 0.05, 0.5

# A cut that crosses a bin leaves at least two widths of border in it, one that only enters it
# less. From so many widths on, vertices are missing, and the evidence of what is left counts for
# this share.
CUT_BORDER_WIDTHS, CUT_RELIABILITY = 0.5, 0.4
# With so many widths of border in the bins before it, the ways to a bin go round a cut, and are
# longer than they were: its chip is no more reliable than one that is cut.
DETOUR_BORDER_WIDTHS = 4.0


def chip_kernel(u: FloatArray) -> FloatArray:
    """Compute what a vertex at fraction u of its bin, in [0, 1), adds to the bin's chip.

    It vanishes at both ends: a vertex that crosses from one bin into the next does not count
    differently all of a sudden.
    """
    return -np.sin(2.0 * np.pi * u)


def measure_chips(
    histograms: RadialHistograms, n_bins: int, scales: FloatArray, offsets: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Measure the chips under every hypothesis.

    Parameters
    ----------
    histograms : RadialHistograms
        With `cells_needed(n_bins, width)` cells.
    n_bins : int
        K.
    scales : (G,) float64
        Factors to the distance.
    offsets : (O,) float64
        What is added to it then, in bins.

    Returns
    -------
    s : (G O, C, K) float64
        Weighted mean of `chip_kernel` over the vertices in each bin, less that over the surface;
        of every scale with each of the offsets.
    n : (G O, C, K) float64
        Effective number of vertices, (sum w)^2 / sum w^2 [1]_.

    References
    ----------
    .. [1] L. Kish, "Survey Sampling", Wiley, 1965.
    """
    bins = _BinSums(histograms.weight.shape[1], n_bins, scales, offsets)
    weight, squared_weight, area = map(
        bins.sums, (histograms.weight, histograms.squared_weight, histograms.area)
    )
    of_vertices, of_surface = map(bins.kernel_sums, (histograms.weight, histograms.area))
    s = _ratio(of_vertices, weight) - _ratio(of_surface, area)
    return s, _ratio(weight**2, squared_weight)


def border_reliability(
    histograms: RadialHistograms,
    n_bins: int,
    width: float,
    scales: FloatArray,
    offsets: FloatArray,
) -> FloatArray:
    """How reliable chips are where the surface's border runs through bins.

    Parameters
    ----------
    histograms, n_bins, scales, offsets
        As for `measure_chips`.
    width : float
        Width of a bin.

    Returns
    -------
    (G O, C, K) float64
        Factors to the evidence, in (0, 1].
    """
    if not histograms.border.any():
        return np.ones(())
    bins = _BinSums(histograms.weight.shape[1], n_bins, scales, offsets)
    border = bins.sums(histograms.border) * np.repeat(scales, len(offsets))[:, None, None]
    nearer = np.cumsum(border, axis=-1) - border
    spoilt = (border >= CUT_BORDER_WIDTHS * width) | (nearer >= DETOUR_BORDER_WIDTHS * width)
    return np.where(spoilt, CUT_RELIABILITY, 1.0)


def soften(s: FloatArray, n: FloatArray) -> FloatArray:
    """Turn chips into soft evidence in (-1, 1); 0 for an erasure."""
    noise = ATTACK_NOISE**2 + SINE_VARIANCE / np.maximum(n, 1.0)
    return np.where(n >= MIN_VERTEX_COUNT, np.tanh(SOFT_GAIN * s / noise), 0.0)


class _BinSums:
    """Sums over the bins of histograms, under every hypothesis."""

    def __init__(self, n_cells: int, n_bins: int, scales: FloatArray, offsets: FloatArray) -> None:
        # The first bin's width about the anchor stays unused: there, vertices must not move.
        ends = np.arange(1, n_bins + 2) - offsets[:, None]
        # A cell is in the bin that its middle is in.
        ends = np.ceil(ends * CELLS_PER_BIN / scales[:, None, None] - 0.5).astype(np.int64)
        self._ends: IntArray = np.clip(ends, 0, n_cells)
        angle = 2.0 * np.pi * scales[:, None] * (np.arange(n_cells) + 0.5) / CELLS_PER_BIN
        self._sin, self._cos = np.sin(angle), np.cos(angle)
        self._shift = 2.0 * np.pi * offsets[:, None, None]

    def sums(self, values: FloatArray) -> FloatArray:
        """Sum values (C, B) over bins, (G O, C, K)."""
        return self._between(np.broadcast_to(values, (len(self._ends), *values.shape)))

    def kernel_sums(self, values: FloatArray) -> FloatArray:
        """Sum values (C, B) times `chip_kernel` over bins, (G O, C, K)."""
        sin, cos = (self._between(values * wave[:, None]) for wave in (self._sin, self._cos))
        shift = np.tile(self._shift, (len(self._ends), 1, 1))
        return -(np.cos(shift) * sin + np.sin(shift) * cos)

    def _between(self, values: FloatArray) -> FloatArray:
        """Sum values (G, C, B) over bins, (G O, C, K)."""
        G, C, B = values.shape
        total = np.zeros((G, C, B + 1))
        np.cumsum(values, axis=2, out=total[:, :, 1:])
        index = self._ends[:, :, None, :]
        at_ends = np.take_along_axis(total[:, None], index, axis=3)
        found: FloatArray = np.diff(at_ends, axis=3)
        return found.reshape(-1, C, found.shape[3])


def _ratio(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0.0)
