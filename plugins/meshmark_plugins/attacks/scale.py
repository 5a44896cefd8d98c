"""Stretching along the axes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark_plugins.attacks.parameters import number, vector
from meshmark_plugins.attacks.polygons import turn
from meshmark_plugins.attacks.similarity import Affine


@dataclass(frozen=True)
class Scale:
    """Scale each axis by a factor of its own, the same in all frames.

    Parameters
    ----------
    strength : float
        Factors are uniform in [1 - strength, 1 + strength], in [0, 1).
    factors : (3,) float, optional
        Factors for x, y and z, none of them 0, instead of random ones. As text: "1,1.2,0.9".
        One or three below 0 mirror the mesh; faces are turned, so that outside stays outside.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    strength: float = 0.1
    factors: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        strength = number("scale", "strength", self.strength, 0, 1, high_open=True)
        object.__setattr__(self, "strength", strength)
        if self.factors is not None:
            factors = vector("scale", "factors", self.factors)
            smallest = min(factors, key=abs)
            number("scale", "size of the smallest of factors", abs(smallest), 0, 1e6, low_open=True)
            object.__setattr__(self, "factors", factors)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the stretched animation."""
        drawn = rng.uniform(1 - self.strength, 1 + self.strength, 3)
        factors = drawn if self.factors is None else np.array(self.factors)
        centre = animation[0].points.mean(axis=0)
        scaled = animation.map(Affine(np.diag(factors), centre, np.zeros(3)))
        return scaled.map(TurnFaces()) if np.prod(factors) < 0 else scaled


@dataclass(frozen=True)
class TurnFaces:
    """Turns the polygons of a frame inside out."""

    def __call__(self, frame: Frame) -> Frame:
        """Return the turned frame."""
        return replace(frame, topology=turn(frame.topology))
