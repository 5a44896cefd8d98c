"""A smooth bend of the whole shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import normalized, surface_box
from meshmark_plugins.attacks.frames import PER, treat_frames
from meshmark_plugins.attacks.parameters import choice, number, whole


@dataclass(frozen=True)
class Bending:
    """Displace a mesh across a random axis, by a power of the place along it.

    The middle stays, and the ends move farthest. What is between follows a parabola, which is an
    arc, or a cubic, which is an S.

    Parameters
    ----------
    amount : float
        Displacement of the ends, as a fraction of the bounding box's diagonal, in [0, 1].
    degree : {2, 3}
        Of the polynomial: 2 moves both ends the same way, 3 opposite ways.
    per : {"frame", "animation"}
        New directions for every frame, or the same ones, about the middle of each.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    amount: float = 0.01
    degree: int = 2
    per: str = "animation"

    def __post_init__(self) -> None:
        object.__setattr__(self, "amount", number("bending", "amount", self.amount, 0, 1))
        object.__setattr__(self, "degree", whole("bending", "degree", self.degree, 2, 3))
        choice("bending", "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the bent animation."""
        bend = BendFrame(self.amount, self.degree)
        return treat_frames(animation, bend, rng, alike=self.per == "animation")


@dataclass(frozen=True)
class BendFrame:
    """Bends one frame."""

    amount: float
    degree: int

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the bent frame."""
        V = frame.points
        axis, other = normalized(rng.normal(size=(2, 3)))
        across = normalized(np.cross(axis, other)[None])[0]
        along = V @ axis
        low, high = along.min(), along.max()
        place = (2.0 * along - low - high) / (high - low) if high > low else np.zeros(len(V))
        size = self.amount * surface_box(V, frame.faces)[0]
        return frame.moved(V + size * (place**self.degree)[:, None] * across)
