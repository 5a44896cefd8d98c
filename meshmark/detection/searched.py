"""What was tried for a bound: each search costs a factor, and p is multiplied by all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Searched:
    """What a verdict is the best of, by the union bound.

    Parameters
    ----------
    beside : bool
        Whether the copy was read beside its original, or alone.
    schemes : int
        Schemes that were tried.
    names : int
        The owner, and every spelling of a recipient's name.
    candidates : int
        Meshes, parts of meshes and meshes together that were tested by all schemes.
    candidate_share : float
        Share of what its scheme may spend that the best of them has; see `decide`.
    look_share : float
        Share of the false-positive rate that this look may spend.
    log10_p : float
        Bound that came of it, corrected for all of this.
    """

    beside: bool
    schemes: int
    names: int
    candidates: int
    candidate_share: float
    look_share: float
    log10_p: float

    @property
    def log10_factor(self) -> float:
        """Log10 of what p was multiplied by."""
        tried = math.log10(self.schemes * self.names)
        return tried - math.log10(self.candidate_share) - math.log10(self.look_share)
