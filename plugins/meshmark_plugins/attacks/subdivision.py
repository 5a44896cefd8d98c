"""Finer polygons: one linear rule for all frames."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.subdivision import LIMITS, RULES, subdivide
from meshmark.mesh.topology import Topology
from meshmark_plugins.attacks.frames import CombinePoints
from meshmark_plugins.attacks.parameters import choice, flag, whole


@dataclass(frozen=True)
class Subdivision:
    """Subdivide every triangle, or every polygon by Catmull and Clark's rule.

    The rules depend on the connectivity alone, so all frames of a constant topology stay so.

    Parameters
    ----------
    scheme : {"midpoint", "loop", "sqrt3", "catmull_clark"}
        Midpoint leaves the surface as it is; the others smooth it.
    steps : int
        How often, in [1, 4].
    limit : bool
        Whether vertices are then put where subdividing for ever would take them: "loop" and
        "catmull_clark" only.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    scheme: str = "midpoint"
    steps: int = 1
    limit: bool = False

    def __post_init__(self) -> None:
        choice("subdivision", "scheme", self.scheme, tuple(RULES))
        object.__setattr__(self, "steps", whole("subdivision", "steps", self.steps, 1, 4))
        object.__setattr__(self, "limit", flag("subdivision", "limit", self.limit))
        if self.limit:
            choice("subdivision with a limit", "scheme", self.scheme, tuple(LIMITS))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the subdivided animation."""
        return animation.map(SubdivideFrame(self.scheme, self.steps, self.limit))


@dataclass(frozen=True)
class SubdivideFrame:
    """Subdivides one frame."""

    scheme: str
    steps: int
    limit: bool = False

    def __call__(self, frame: Frame) -> Frame:
        """Return the subdivided frame."""
        return subdivider(self.scheme, self.steps, self.limit, frame.topology)(frame)


@lru_cache(maxsize=4)
def subdivider(scheme: str, steps: int, limit: bool, topology: Topology) -> CombinePoints:
    """Build the new points' weights and polygons; remembered for the topologies used last."""
    weights, finer = subdivide(topology, scheme, steps)
    if limit:
        weights = csr_matrix(LIMITS[scheme](finer) @ weights)
    return CombinePoints(weights, finer)
