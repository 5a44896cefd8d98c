"""Units of length that a copy remembers: a fixed series, from which each piece takes one.

The root area of what is left of a mesh does not tell the root area it was marked with. So pieces
are not marked in root areas but in the member of a geometric series that is nearest. On a copy
that has kept its scale only few members come into question, whatever was cut away. The series
goes on through all powers of ten, so that neither metres nor centimetres make a difference.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray

# Members in each power of ten: neighbours differ by a fifth.
PER_DECADE = 12
# One member in `PERIOD` could be a piece's unit; all pieces take theirs from the same ones,
# so that one guess does for all.
PERIOD = 4
# How far below its root area the unit of a piece may be, in members.
LOWEST = -1.0


def phase_of(root_area: float) -> float:
    """Choose the phase that has a unit nearest to the root area of the largest piece."""
    return float(np.round(_place(root_area)) % PERIOD)


def units(root_area: float, phases: FloatArray) -> FloatArray:
    """Find the unit of a piece in root areas, for every phase of the series, (P,) float64.

    Parameters
    ----------
    root_area : float
        Square root of the piece's area, in units of the mesh.
    phases : (P,) float64
        Which members are meant: those at phase + `PERIOD` k. Not whole where the series itself
        was shifted: by a change of scale.
    """
    away = np.mod(phases - _place(root_area) - LOWEST, PERIOD) + LOWEST
    return scale(away)


def scale(members: FloatArray) -> FloatArray:
    """Ratio between lengths that are so many members of the series apart."""
    return 10.0 ** (members / PER_DECADE)


def members(ratio: FloatArray) -> FloatArray:
    """How many members of the series lie between lengths of some ratio."""
    return PER_DECADE * np.log10(ratio)


def _place(root_area: float) -> float:
    return PER_DECADE * float(np.log10(root_area))
