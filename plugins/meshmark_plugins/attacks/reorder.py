"""Vertices and faces in another order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark_plugins.attacks.frames import (
    PER,
    KeepPoints,
    require_trajectories,
    treat_frames,
)
from meshmark_plugins.attacks.parameters import choice
from meshmark_plugins.attacks.polygons import permute


@dataclass(frozen=True)
class Reorder:
    """Shuffle the vertices and the polygons; the surface stays what it is.

    Parameters
    ----------
    per : {"frame", "animation"}
        A new order for every frame, or one for all.

    Raises
    ------
    UsageError
        If the parameter is out of range.
    """

    per: str = "animation"

    def __post_init__(self) -> None:
        choice("reorder", "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the shuffled animation."""
        if self.per == "frame":
            single = len(animation) == 1
            return treat_frames(animation, Shuffle(), rng, constant_topology=single)
        require_trajectories("reorder", animation, "per='animation'")
        return animation.map(Shuffle().draw(animation[0], rng))


@dataclass(frozen=True)
class Shuffle:
    """Shuffles one frame."""

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the shuffled frame."""
        return self.draw(frame, rng)(frame)

    def draw(self, frame: Frame, rng: np.random.Generator) -> KeepPoints:
        """Draw a new order for a frame's vertices and polygons."""
        vertices = rng.permutation(frame.topology.n_points)
        polygons = rng.permutation(len(frame.topology.counts))
        return KeepPoints(vertices, permute(frame.topology, vertices, polygons))
