"""Evening out the density of vertices on a surface that stays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.smoothing import polygon_umbrella
from meshmark_plugins.attacks.parameters import number, whole
from meshmark_plugins.attacks.sliding import slide, tangential


@dataclass(frozen=True)
class Relaxation:
    """Move every vertex along the surface towards the mean of its neighbours, again and again.

    Each step is an umbrella step along polygon edges with what lies along the normals taken out;
    then every vertex goes to the closest point of the original surface. Border vertices stay.

    Parameters
    ----------
    steps : int
        Number of steps, all vertices at once, in [0, 1000].
    strength : float
        Size of a step, a share of the way to the mean, in (0, 1].

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    steps: int = 5
    strength: float = 1.0

    def __post_init__(self) -> None:
        strength = number("relaxation", "strength", self.strength, 0, 1, low_open=True)
        object.__setattr__(self, "steps", whole("relaxation", "steps", self.steps, 0, 1000))
        object.__setattr__(self, "strength", strength)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the relaxed animation."""
        return animation.map(RelaxFrame(self.steps, self.strength))


@dataclass(frozen=True)
class RelaxFrame:
    """Relaxes one frame."""

    steps: int
    strength: float

    def __call__(self, frame: Frame) -> Frame:
        """Return the relaxed frame."""
        V, F = frame.points, frame.faces
        L = polygon_umbrella(frame.topology)
        surface = ClosestPoints(V, F)
        for _ in range(self.steps):
            V = slide(surface, V, tangential(V, F, self.strength * (L @ V)))
        return frame.moved(V)
