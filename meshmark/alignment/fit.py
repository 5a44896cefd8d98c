"""How well a copy lies where it was placed, and whether it lies as well elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshmark.alignment.refinement import Placement
from meshmark.alignment.robust import TUKEY, scale_of
from meshmark.arrays import FloatArray

# Where an exact placement starts, most vertices are nearer than this share of the diagonal.
REACH = 0.05
# Nearer vertices lie on the original, if the normals agree.
NEAR = 0.02
# The share of them whose distances make the residual, in mean squares, and what it may be.
KEPT, FITS = 0.9, 0.008
# Paired vertices may slide along the surface.
FITS_PAIRED = 0.03
# Either most of the copy lies on the original, or most of the original has copy on it.
MOST, LEAST = 0.6, 0.03
# The right placement leaves no more than marks do, or covers the whole. If one does neither, local
# features are tried, too: a part often fits somewhere else, tolerably.
WELL, WHOLE = 2e-4, 0.97
# Distances in single precision.
ROUNDING = 1e-7
# Distances of so many vertices err alike.
CORRELATED = 10
# One placement is better if its distances are smaller by this factor, or so many standard errors.
SURE, ALIKE = 5.0, 1.5

NOWHERE = "the copy lies nowhere on the original"


@dataclass(frozen=True, eq=False)
class Fit:
    """A placement of a frame, and what is left.

    Parameters
    ----------
    placement : Placement
    distances : (n,) float64
        Of some of the vertices from the surface, as shares of the diagonal.
    near : float
        Share of the vertices that lie on the original.
    covered : float
        Share of the original's area that has vertices on it.
    extent : float
        Diagonal of these vertices, as a share of the original's; in rough fits, of all.
    slip : float
        See `meshmark.alignment.matching.Match.slip`; 0 for vertices that are not paired.
    """

    placement: Placement
    distances: FloatArray
    near: float = 0.0
    covered: float = 0.0
    extent: float = 0.0
    slip: float = 0.0

    @cached_property
    def residual(self) -> float:
        """Root mean square distance of the vertices that belong there, but the farthest tenth."""
        within = np.sort(self.distances[self.distances < NEAR])
        if within.size:
            within = within[within <= TUKEY * max(scale_of(within), ROUNDING)]
        within = within[: max(1, round(KEPT * len(within)))]
        return float(np.sqrt((within**2).mean())) if within.size else np.inf

    @property
    def fits(self) -> bool:
        """Whether the copy lies there."""
        return (
            self.residual < FITS * min(1.0, self.extent)
            and max(self.near, self.covered) >= MOST
            and self.covered >= LEAST
        )

    @property
    def is_good(self) -> bool:
        """Whether nothing better is to be expected: that it fits is no accident of a symmetry."""
        return self.fits and (self.residual < WELL or self.covered > WHOLE)

    @property
    def misfit(self) -> float:
        """Mean distance, where whatever is not near counts as far, in diagonals of the copy.

        Else, the best placement would be one that shrinks the copy to a point.
        """
        size = min(1.0, max(self.extent, ROUNDING))
        return float(np.minimum(self.distances, REACH).mean()) / size


def alike(own: FloatArray, theirs: FloatArray) -> bool:
    """Tell whether distances (n,) under two placements may be equal but for chance."""
    difference = theirs - own
    error = difference.std() / np.sqrt(max(len(difference) / CORRELATED, 1.0))
    near = theirs.mean() < ALIKE * own.mean() + ROUNDING
    return bool(near and difference.mean() < SURE * error + ROUNDING)


def best_of(one: Fit | None, other: Fit | None) -> Fit | None:
    """Keep the better of two fits, or the only one."""
    if one is None or other is None:
        return one or other
    return other if better(other, one) else one


def better(one: Fit, other: Fit) -> bool:
    """Tell whether one fits where the other does not, or is nearer."""
    return (one.fits, -one.misfit) > (other.fits, -other.misfit)


def misfit(fit: Fit) -> float:
    """Return `Fit.misfit`, to sort by."""
    return fit.misfit


def shortfall(fit: Fit) -> str:
    """Say why the best placement is none."""
    if fit.covered < LEAST:
        return NOWHERE
    return (
        f"at best {fit.near:.0%} of the copy lie on {fit.covered:.0%} of the original, "
        f"{fit.residual:.2%} of its diagonal away"
    )
