"""Which point of the posed original each vertex of a copy belongs to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from meshmark.alignment.poses import motion, posed
from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import area_vectors, normalized, vertex_normals


@dataclass(frozen=True, eq=False)
class Match:
    """The points of a surface that n vertices belong to.

    Parameters
    ----------
    points, normals, motion : (n, 3) float64
        Where they are, the unit normals there, and how they move with the pose.
    slip : float
        Weight of distances along the surface against those across it.
    """

    points: FloatArray
    normals: FloatArray
    motion: FloatArray
    slip: float


class Matcher(Protocol):
    """Finds matches on the original in one pose."""

    def match(self, X: FloatArray) -> Match:
        """Match vertices of the copy at X (n, 3) in the original's space."""
        ...


class ByClosestPoint:
    """Vertices belong to the closest point of the surface; they may slip along it."""

    def __init__(self, original: MeshAnimation, pose: float) -> None:
        frame = posed(original, pose)
        self._V, self._F = frame.points, frame.faces
        self._normals = normalized(area_vectors(self._V, self._F))
        self._motion = motion(original, pose)
        self._surface = ClosestPoints(self._V, self._F)

    def match(self, X: FloatArray) -> Match:
        """Match each vertex with the closest point."""
        face, weights = self._surface.find(X)
        corners = self._F[face]

        def at(values: FloatArray) -> FloatArray:
            mean: FloatArray = np.einsum("ij,ijk->ik", weights, values[corners])
            return mean

        return Match(at(self._V), self._normals[face], at(self._motion), 0.0)


class ByIdentity:
    """Vertex i of the copy belongs to vertex i.

    Noise and simplification along the surface say little of where the surface is.
    """

    SLIP = 0.1

    def __init__(self, original: MeshAnimation, pose: float, vertices: IntArray) -> None:
        frame = posed(original, pose)
        normals = vertex_normals(frame.points, frame.faces)
        rate = motion(original, pose)
        self._match = Match(frame.points[vertices], normals[vertices], rate[vertices], self.SLIP)

    def match(self, X: FloatArray) -> Match:
        """Match each vertex with its own."""
        return self._match
