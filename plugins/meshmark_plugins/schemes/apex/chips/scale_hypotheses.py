"""Hypotheses of the unit that a copy was marked in, and of shifts of distance, with their priors.

A hypothesis is a residue of the unit series with a factor to all distances, and an offset that is
added to them. Evidence is taken under every hypothesis, and averaged with these priors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark_plugins.schemes.apex.anchors.geodesic_field import DISC_RADIUS
from meshmark_plugins.schemes.apex.chips.radial_histogram import CELLS_PER_BIN
from meshmark_plugins.schemes.apex.chips.unit_series import (
    LOWEST_STEP,
    SERIES_PERIOD,
    ratio_to_steps,
    relative_units,
    steps_to_ratio,
)

# Simplification and smoothing move a tip, and with it where distance begins; in bins. The prior
# of an offset falls by exp(-|offset| / OFFSET_DECAY).
OFFSETS: FloatArray = np.array([0.0, -0.15, 0.15, -0.3, 0.3])
OFFSET_DECAY = 0.15

# Prior probability that a copy has kept its scale. Its unit is then one of the series; what
# attacks and poses do to all distances is one of these factors, each with its prior.
P_SCALE_KEPT = 0.65
SCALE_JITTER: FloatArray = np.array([1.0, 0.985, 1.015, 0.97, 1.03, 0.955])
SCALE_JITTER_PRIOR: FloatArray = np.array([0.42, 0.18, 0.18, 0.09, 0.07, 0.06])
# If not, the unit may be anything: so many hypotheses a step of the series.
FREE_SCALES_PER_STEP = 8

# Prior of a unit by how many steps it is above the root area: even up to as far as the nearest
# member can be, then falling exponentially, and nowhere below a floor. Cropping makes a root area
# shorter than its unit by much, noise longer by little.
FLAT_STEPS, DECAY_STEPS_ABOVE, DECAY_STEPS_BELOW, PRIOR_FLOOR = 0.5, 0.6, 0.2, 0.05


@dataclass(frozen=True, eq=False)
class ScaleHypotheses:
    """Hypotheses of the residue of the unit series, and of a factor to all distances.

    Parameters
    ----------
    residue, jitter : (G,) float64
        See `unit_series`, and `SCALE_JITTER`. In the first hypothesis, units are nearly root
        areas.
    log_scale_prior : (G,) float64
        Natural logarithm of the prior of each; the exponentials sum to 1.
    """

    residue: FloatArray
    jitter: FloatArray
    log_scale_prior: FloatArray

    @classmethod
    def about(cls, root_area: float) -> ScaleHypotheses:
        """List hypotheses by the root area of the largest component."""
        free = LOWEST_STEP + (np.arange(SERIES_PERIOD * FREE_SCALES_PER_STEP) + 0.5) / (
            FREE_SCALES_PER_STEP
        )
        free = free[np.argsort(np.abs(free), kind="stable")]
        kept = np.repeat(np.arange(float(SERIES_PERIOD)), len(SCALE_JITTER))
        residue = np.concatenate([free + ratio_to_steps(np.array(root_area)), kept])
        jitter = np.concatenate([np.ones(len(free)), np.tile(SCALE_JITTER, SERIES_PERIOD)])
        steps = ratio_to_steps(relative_units(root_area, residue))
        prior = np.exp(
            -np.maximum(0.0, steps - FLAT_STEPS) / DECAY_STEPS_ABOVE
            - np.maximum(0.0, -FLAT_STEPS - steps) / DECAY_STEPS_BELOW
        )
        prior += PRIOR_FLOOR
        prior[len(free) :] *= np.tile(SCALE_JITTER_PRIOR, SERIES_PERIOD)
        of_free, of_kept = np.split(prior, [len(free)])
        prior = np.concatenate(
            [(1.0 - P_SCALE_KEPT) * of_free / of_free.sum(), P_SCALE_KEPT * of_kept / of_kept.sum()]
        )
        return cls(residue, jitter, np.log(prior))

    def scales(self, root_area: float) -> FloatArray:
        """Factor that turns distances in root areas of a component into those in units, (G,)."""
        return self.jitter / relative_units(root_area, self.residue)

    @property
    def log_prior(self) -> FloatArray:
        """Log prior of each scale with each of the offsets, (G O,)."""
        of_offset = np.exp(-np.abs(OFFSETS) / OFFSET_DECAY)
        log_prior = self.log_scale_prior[:, None] + np.log(of_offset / of_offset.sum())
        return log_prior.ravel()


def cells_needed(n_bins: int, width: float) -> int:
    """Count the cells a histogram must have for every hypothesis to see all of its bins."""
    farthest = max((n_bins + 1 - OFFSETS.min()) * width, DISC_RADIUS)
    longest = float(steps_to_ratio(np.array(LOWEST_STEP + SERIES_PERIOD))) / SCALE_JITTER.min()
    return int(np.ceil(farthest * longest / width)) * CELLS_PER_BIN
