"""Cutting part of the mesh away with a plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import IntArray
from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark_plugins.attacks.frames import (
    PER,
    KeepPoints,
    naming,
    require_trajectories,
    treat_frames,
)
from meshmark_plugins.attacks.parameters import choice, number, vector
from meshmark_plugins.attacks.polygons import restrict


@dataclass(frozen=True)
class Cropping:
    """Remove the share of the vertices that lies farthest along a direction.

    Polygons that lose a corner go, and so do vertices that are left without a polygon, as an
    exporter would drop them; the share is that of the vertices behind the plane.

    Parameters
    ----------
    share : float
        Fraction of the vertices behind the plane, in [0, 1).
    direction : (3,) float, optional
        Normal of the plane, pointing to what is cut away, of any length but zero; a random
        direction if not given. As text: "0,1,0".
    per : {"frame", "animation"}
        A new plane, and so a new connectivity, for every frame; or one plane through the first
        frame, whose cut follows the vertices through all the others.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    share: float = 0.1
    direction: tuple[float, float, float] | None = None
    per: str = "animation"

    def __post_init__(self) -> None:
        share = number("cropping", "share", self.share, 0, 1, high_open=True)
        object.__setattr__(self, "share", share)
        if self.direction is not None:
            direction = vector("cropping", "direction", self.direction)
            length = float(np.linalg.norm(direction))
            number("cropping", "direction's length", length, 0, np.inf, low_open=True)
            object.__setattr__(self, "direction", direction)
        choice("cropping", "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the cropped animation."""
        crop = CropFrame(self.share, self.direction)
        if self.per == "frame":
            return treat_frames(animation, crop, rng, constant_topology=len(animation) == 1)
        require_trajectories("cropping", animation, "per='animation'")
        with naming(animation.origin, animation.prim, float(animation.times[0])):
            return animation.map(KeepPoints(*crop.cut(animation[0], rng)))


@dataclass(frozen=True)
class CropFrame:
    """Crops one frame."""

    share: float
    direction: tuple[float, float, float] | None

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the cropped frame."""
        return KeepPoints(*self.cut(frame, rng))(frame)

    def cut(self, frame: Frame, rng: np.random.Generator) -> tuple[IntArray, Topology]:
        """Find the vertices that stay, and the polygons over them."""
        normal = rng.normal(size=3) if self.direction is None else np.array(self.direction)
        height = frame.points @ normal
        n = len(height)
        keep = np.ones(n, dtype=bool)
        keep[np.argsort(-height, kind="stable")[: round(self.share * n)]] = False
        indices, topology = restrict(frame.topology, keep)
        if topology is None:
            raise InputError(f"cropping {self.share:g} leaves no face")
        return indices, topology
