"""Random moves of vertices along a surface that stays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import lengths, normalized
from meshmark.mesh.topology import polygon_edges
from meshmark_plugins.attacks.carrying import carry_by_surface, rebuild
from meshmark_plugins.attacks.frames import PER, CombinePoints, treat_frames
from meshmark_plugins.attacks.parameters import choice, number
from meshmark_plugins.attacks.sliding import slide, tangential


@dataclass(frozen=True)
class Jitter:
    """Move every vertex a random way in the tangent plane, and back on the surface.

    Parameters
    ----------
    size : float
        Radius of the disc that the move is drawn from, evenly, in mean edge lengths of the
        frame, in [0, 10].
    per : {"frame", "animation"}
        Fresh moves for every frame; or moves on the first frame, whose surface carries the
        vertices to the others.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    size: float = 1.0
    per: str = "animation"

    def __post_init__(self) -> None:
        object.__setattr__(self, "size", number("jitter", "size", self.size, 0, 10))
        choice("jitter", "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the animation with its vertices elsewhere on its surface."""
        function = JitterFrame(self.size)
        if self.per == "frame":
            return treat_frames(animation, function, rng)
        return rebuild("jitter", animation, function, _carry, self.per, rng)


@dataclass(frozen=True)
class JitterFrame:
    """Moves the vertices of one frame."""

    size: float

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the frame with its vertices elsewhere on its surface."""
        V, F = frame.points, frame.faces
        i, j = polygon_edges(frame.topology.counts, frame.topology.indices)[0].T
        radius = self.size * lengths(V[i] - V[j]).mean() * np.sqrt(rng.random(len(V)))
        D = radius[:, None] * normalized(tangential(V, F, rng.normal(size=V.shape)))
        D[_loose(frame)] = 0.0
        return frame.moved(slide(ClosestPoints(V, F), V, D))


def _loose(frame: Frame) -> NDArray[np.bool_]:
    """Tell which points are no corner of any polygon, (N,) bool."""
    return np.bincount(frame.topology.indices, minlength=len(frame.points)) == 0


def _carry(frame: Frame, V: FloatArray, F: IntArray) -> CombinePoints:
    loose = _loose(frame)
    pinned = diags_array((~loose).astype(float)) @ carry_by_surface(frame, V, F).weights
    weights = csr_matrix(pinned + diags_array(loose.astype(float)))
    return CombinePoints(weights, frame.topology)
