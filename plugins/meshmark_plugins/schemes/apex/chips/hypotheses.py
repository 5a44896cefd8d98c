"""Readings: chips of radial profiles under every hypothesis of the unit and of the offset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray
from meshmark_plugins.schemes.apex.anchors.geodesic_field import DISC_RADIUS
from meshmark_plugins.schemes.apex.chips.radial_histogram import CELLS, Profiles
from meshmark_plugins.schemes.apex.chips.unit_series import LOWEST, PERIOD, members, scale, units

# Simplification and smoothing move a tip, and with it where distance begins; in bins. How fast
# belief falls with that.
OFFSETS: FloatArray = np.array([0.0, -0.15, 0.15, -0.3, 0.3])
OFFSET_SPREAD = 0.15

# Belief that a copy has kept its scale. Its unit is then one of the series; what attacks and
# poses add to all distances is one of STRAYS, as a factor, with the belief in it.
SCALE_KEPT = 0.65
STRAYS: FloatArray = np.array([1.0, 0.985, 1.015, 0.97, 1.03, 0.955])
STRAY_BELIEF: FloatArray = np.array([0.42, 0.18, 0.18, 0.09, 0.07, 0.06])
# If not, the unit may be anything: so many choices from one member of the series to the next.
FINENESS = 8

# Belief in units by how many members of the series they are from the root area: even as far as
# the nearest member can be, then falling. Cropping makes a root area shorter than its unit by
# much, noise longer by little.
NEAREST, SHORTER, LONGER, ANY = 0.5, 0.6, 0.2, 0.05

# Bins with fewer vertices than this (their number weighed as Kish does) are erasures.
LEAST_COUNT = 12.0
# Softening: a chip's evidence is tanh(GAIN s / (STRAY^2 + HOST / n)). HOST / n is the variance
# that sin has for n vertices strewn at random, STRAY what attacks add whatever n is.
GAIN, STRAY, HOST = 0.08, 0.05, 0.5

# A cut that crosses a bin leaves at least two widths of border in it, one that only enters it
# less. From so many widths on, vertices are missing, and what is left says so much less.
LEAST_BORDER, CUT_WORTH = 0.5, 0.4
# With so many widths of border in the bins before it, the ways to a bin go round a cut, and are
# longer than they were: it says no more than one that is cut.
DETOUR = 4.0


@dataclass(frozen=True, eq=False)
class Guesses:
    """Guesses of the phase of the series, and of a factor to all distances.

    Parameters
    ----------
    phase, factor : (G,) float64
        See `unit_series`. In the first, units are nearly root areas.
    log_belief : (G,) float64
        Natural logarithm of the belief in each; the exponentials sum to 1.
    """

    phase: FloatArray
    factor: FloatArray
    log_belief: FloatArray

    @classmethod
    def about(cls, root_area: float) -> Guesses:
        """Guess from the root area of the largest piece."""
        free = LOWEST + (np.arange(PERIOD * FINENESS) + 0.5) / FINENESS
        free = free[np.argsort(np.abs(free), kind="stable")]
        kept = np.repeat(np.arange(float(PERIOD)), len(STRAYS))
        phase = np.concatenate([free + members(np.array(root_area)), kept])
        factor = np.concatenate([np.ones(len(free)), np.tile(STRAYS, PERIOD)])
        away = members(units(root_area, phase))
        near = np.exp(
            -np.maximum(0.0, away - NEAREST) / SHORTER - np.maximum(0.0, -NEAREST - away) / LONGER
        )
        near += ANY
        near[len(free) :] *= np.tile(STRAY_BELIEF, PERIOD)
        of_free, of_kept = np.split(near, [len(free)])
        belief = np.concatenate(
            [(1.0 - SCALE_KEPT) * of_free / of_free.sum(), SCALE_KEPT * of_kept / of_kept.sum()]
        )
        return cls(phase, factor, np.log(belief))

    def scales(self, root_area: float) -> FloatArray:
        """Factor that turns distances in root areas of a piece into those in units, (G,)."""
        return self.factor / units(root_area, self.phase)

    @property
    def log_prior(self) -> FloatArray:
        """Log belief in each reading: a guess with each of the offsets, (G O,)."""
        of_offset = np.exp(-np.abs(OFFSETS) / OFFSET_SPREAD)
        log_prior = self.log_belief[:, None] + np.log(of_offset / of_offset.sum())
        return log_prior.ravel()


def cells_needed(n_bins: int, width: float) -> int:
    """Count the cells a profile must have for every reading to see all of its bins."""
    farthest = max((n_bins + 1 - OFFSETS.min()) * width, DISC_RADIUS)
    longest = float(scale(np.array(LOWEST + PERIOD))) / STRAYS.min()
    return int(np.ceil(farthest * longest / width)) * CELLS


def phase(u: FloatArray) -> FloatArray:
    """Compute what a vertex at place u of its bin, in [0, 1), adds to the bin's chip.

    It vanishes at both ends: a vertex that crosses from one bin into the next does not count
    differently all of a sudden.
    """
    return -np.sin(2.0 * np.pi * u)


def measure(
    profiles: Profiles, n_bins: int, scales: FloatArray, offsets: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Measure the chips under every hypothesis.

    Parameters
    ----------
    profiles : Profiles
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
        Weighted mean phase of the vertices in each bin, less that of the surface; of every
        scale with each of the offsets.
    n : (G O, C, K) float64
        How many vertices that mean is worth.
    """
    bins = _Bins(profiles.weight.shape[1], n_bins, scales, offsets)
    weight, square, area = map(bins.sums, (profiles.weight, profiles.square, profiles.area))
    tilt, even = map(bins.phased, (profiles.weight, profiles.area))
    s = _ratio(tilt, weight) - _ratio(even, area)
    return s, _ratio(weight**2, square)


def worth(
    profiles: Profiles, n_bins: int, width: float, scales: FloatArray, offsets: FloatArray
) -> FloatArray:
    """How far chips are to be believed where the surface's border runs through bins.

    Parameters
    ----------
    profiles, n_bins, scales, offsets
        As for `measure`.
    width : float
        Width of a bin.

    Returns
    -------
    (G O, C, K) float64
        Factors to the evidence, in (0, 1].
    """
    if not profiles.border.any():
        return np.ones(())
    bins = _Bins(profiles.weight.shape[1], n_bins, scales, offsets)
    border = bins.sums(profiles.border) * np.repeat(scales, len(offsets))[:, None, None]
    nearer = np.cumsum(border, axis=-1) - border
    spoilt = (border >= LEAST_BORDER * width) | (nearer >= DETOUR * width)
    return np.where(spoilt, CUT_WORTH, 1.0)


class _Bins:
    """Where bins begin and end among the cells of profiles, under every hypothesis."""

    def __init__(self, n_cells: int, n_bins: int, scales: FloatArray, offsets: FloatArray) -> None:
        # The first bin's width about the anchor stays unused: there, vertices must not move.
        ends = np.arange(1, n_bins + 2) - offsets[:, None]
        # A cell is in the bin that its middle is in.
        ends = np.ceil(ends * CELLS / scales[:, None, None] - 0.5).astype(np.int64)
        self._ends: NDArray[np.int64] = np.clip(ends, 0, n_cells)
        turn = 2.0 * np.pi * scales[:, None] * (np.arange(n_cells) + 0.5) / CELLS
        self._sin, self._cos = np.sin(turn), np.cos(turn)
        self._shift = 2.0 * np.pi * offsets[:, None, None]

    def sums(self, values: FloatArray) -> FloatArray:
        """Sum values (C, B) over bins, (G O, C, K)."""
        return self._between(np.broadcast_to(values, (len(self._ends), *values.shape)))

    def phased(self, values: FloatArray) -> FloatArray:
        """Sum values (C, B) times `phase` over bins, (G O, C, K)."""
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


def soften(s: FloatArray, n: FloatArray) -> FloatArray:
    """Turn chips into evidence in (-1, 1); 0 where too few vertices speak."""
    noise = STRAY**2 + HOST / np.maximum(n, 1.0)
    return np.where(n >= LEAST_COUNT, np.tanh(GAIN * s / noise), 0.0)


def _ratio(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.divide(a, b, out=np.zeros_like(a), where=b > 0.0)
