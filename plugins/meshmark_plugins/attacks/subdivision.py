"""Finer polygons: one linear rule for all frames."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.subdivision import RULES, subdivide
from meshmark.mesh.topology import Topology
from meshmark_plugins.attacks.frames import CombinePoints
from meshmark_plugins.attacks.parameters import choice, whole


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

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    scheme: str = "midpoint"
    steps: int = 1

    def __post_init__(self) -> None:
        choice("subdivision", "scheme", self.scheme, tuple(RULES))
        object.__setattr__(self, "steps", whole("subdivision", "steps", self.steps, 1, 4))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the subdivided animation."""
        return animation.map(SubdivideFrame(self.scheme, self.steps))


@dataclass(frozen=True)
class SubdivideFrame:
    """Subdivides one frame."""

    scheme: str
    steps: int

    def __call__(self, frame: Frame) -> Frame:
        """Return the subdivided frame."""
        return subdivider(self.scheme, self.steps, frame.topology)(frame)


@lru_cache(maxsize=4)
def subdivider(scheme: str, steps: int, topology: Topology) -> CombinePoints:
    """Build the new points' weights and polygons; remembered for the topologies used last."""
    return CombinePoints(*subdivide(topology, scheme, steps))
