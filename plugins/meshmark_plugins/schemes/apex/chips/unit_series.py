"""Units of length that a copy remembers: a fixed series, from which each component takes one.

The root area of what is left of a mesh does not tell the root area it was marked with. So marks
are measured not in root areas but in the nearest member of a geometric series. Of a copy that has
kept its scale, only few members come into question, whatever was cut away. The series goes on
through all powers of ten, so that metres and centimetres make no difference.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray

# Steps from a member to the one ten times as long: neighbours differ by a fifth.
STEPS_PER_DECADE = 12
# Only members whose numbers leave one residue modulo this are units of a mesh's components, so
# that one guess, of the residue, does for all of them.
SERIES_PERIOD = 4
# Lowest the unit of a component may be, in steps from its root area.
LOWEST_STEP = -1.0


def nearest_residue(root_area: float) -> float:
    """Choose the residue that has a unit nearest to the root area of the largest component."""
    return float(np.round(_steps_from_one(root_area)) % SERIES_PERIOD)


def relative_units(root_area: float, residues: FloatArray) -> FloatArray:
    """Find the unit of a component in its root areas, for every residue, (P,) float64.

    Parameters
    ----------
    root_area : float
        Square root of the component's area, in lengths of the mesh.
    residues : (P,) float64
        Which members are meant: those at residue + `SERIES_PERIOD` k. Not whole where the series
        itself was shifted by a change of scale.
    """
    steps = np.mod(residues - _steps_from_one(root_area) - LOWEST_STEP, SERIES_PERIOD) + LOWEST_STEP
    return steps_to_ratio(steps)


def steps_to_ratio(steps: FloatArray) -> FloatArray:
    """Ratio between lengths that are so many steps of the series apart."""
    return 10.0 ** (steps / STEPS_PER_DECADE)


def ratio_to_steps(ratio: FloatArray) -> FloatArray:
    """How many steps of the series lie between lengths of some ratio."""
    return STEPS_PER_DECADE * np.log10(ratio)


def _steps_from_one(root_area: float) -> float:
    return STEPS_PER_DECADE * float(np.log10(root_area))
