"""Finer triangles: one linear rule for all frames."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_matrix, eye_array

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark_plugins.attacks.frames import CombinePoints
from meshmark_plugins.attacks.parameters import choice, whole
from meshmark_plugins.attacks.subdivision_rules import RULES


@dataclass(frozen=True)
class Subdivision:
    """Subdivide every triangle. Polygons are triangulated first.

    The rules depend on the connectivity alone, so all frames of a constant topology stay so.

    Parameters
    ----------
    scheme : {"midpoint", "loop", "sqrt3"}
        Midpoint leaves the surface as it is; Loop and sqrt(3) smooth it.
    steps : int
        How often, in [1, 4].

    Raises
    ------
    UsageError
        If a parameter is out of range.

    References
    ----------
    C. T. Loop, "Smooth subdivision surfaces based on triangles", MSc thesis, University of
    Utah, 1987.
    L. Kobbelt, "sqrt(3)-subdivision", SIGGRAPH 2000, doi:10.1145/344779.344835.
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
    """Build the new points' weights and triangles; remembered for the topologies used last."""
    F = topology.triangles
    W = csr_matrix(eye_array(topology.n_points))
    for _ in range(steps):
        step, F = RULES[scheme](F, W.shape[0])
        W = csr_matrix(step @ W)
    return CombinePoints(W, Topology.from_triangles(F, W.shape[0]))
