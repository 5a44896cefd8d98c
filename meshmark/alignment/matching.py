"""Which point of the posed original each vertex of a copy belongs to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from scipy.spatial import cKDTree

from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.original import Original
from meshmark.alignment.pose_samples import PoseSamples
from meshmark.alignment.poses import motion, posed
from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import area_vectors, lengths, normalized, vertex_normals

# Keeps what is its own image under a turn from turning.
LEAST_SLIP = 1e-4


@dataclass(frozen=True, eq=False)
class Match:
    """The points of a surface that n vertices belong to.

    Parameters
    ----------
    points, normals, motion : (n, 3) float64
        Where they are, the unit normals there, and how they move with the pose.
    paired : bool
        Whether these are the very points, so that distances along the surface count, too.
    """

    points: FloatArray
    normals: FloatArray
    motion: FloatArray
    paired: bool

    def slip(self, gap: FloatArray) -> float:
        """Compute the weight of distances along the surface against those across it.

        Parameters
        ----------
        gap : (n, 3) float64
            From the matched points to the vertices.

        Returns
        -------
        float
            The ratio of the variances across and along, at most 1: noise counts in all
            directions, what slides along the surface hardly does. 0 if the points are not paired.
        """
        if not self.paired:
            return 0.0
        across = (gap * self.normals).sum(axis=1)
        along = lengths(gap - across[:, None] * self.normals)
        # Medians of the moduli of one normal deviate, and of two.
        one, two = np.median(np.abs(across)) / 0.6745, np.median(along) / 1.1774
        return 1.0 if one >= two else max(float(one / two) ** 2, LEAST_SLIP)


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

        return Match(at(self._V), self._normals[face], at(self._motion), False)


class BySamples:
    """Vertices belong to the nearest sample, and slip along its face: quick, and rough."""

    def __init__(self, samples: PoseSamples, pose: float) -> None:
        self._points, self._normals, self._motion = samples.blend(pose)
        self._tree: Any = cKDTree(self._points)

    def match(self, X: FloatArray) -> Match:
        """Match each vertex with the nearest sample."""
        nearest = self._tree.query(X)[1]
        return Match(self._points[nearest], self._normals[nearest], self._motion[nearest], False)


class ByIdentity:
    """Vertex i of the copy belongs to vertex i."""

    def __init__(self, original: MeshAnimation, pose: float, vertices: IntArray) -> None:
        frame = posed(original, pose)
        normals = vertex_normals(frame.points, frame.faces)
        rate = motion(original, pose)
        self._match = Match(frame.points[vertices], normals[vertices], rate[vertices], True)

    def match(self, X: FloatArray) -> Match:
        """Match each vertex with its own."""
        return self._match


@dataclass(frozen=True, eq=False)
class ClosestAt:
    """Matches vertices with the closest points of the original in a pose."""

    original: Original

    def __call__(self, pose: float) -> Matcher:
        """Return the matcher of a pose."""
        return ByClosestPoint(self.original.animation, pose)


@dataclass(frozen=True, eq=False)
class SamplesAt:
    """Matches vertices with the nearest of some samples of the original in a pose."""

    original: Original

    def __call__(self, pose: float) -> Matcher:
        """Return the matcher of a pose."""
        return BySamples(self.original.samples, pose)


@dataclass(frozen=True, eq=False)
class PairedAt:
    """Matches vertices with their own of the original in a pose."""

    original: Original
    frame: CopyFrame

    def __call__(self, pose: float) -> Matcher:
        """Return the matcher of a pose."""
        return ByIdentity(self.original.animation, pose, self.frame.vertices)
