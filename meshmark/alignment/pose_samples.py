"""Few points of the original in many poses, so that rough searches need not read it again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.closest_points import surface_samples
from meshmark.mesh.geometry import area_vectors, face_areas, lengths, normalized

MOST_POSES, POINTS = 64, 2000
# Of distances to a sample, what its neighbours are apart says nothing.
KEPT = 0.7


class PoseSamples:
    """Points spread over the original by area, the same in all of many poses.

    Parameters
    ----------
    original : MeshAnimation
        Of constant topology.

    Attributes
    ----------
    poses : (K,) int
        Frames of the original: all, or `MOST_POSES` spread evenly.
    points, normals : (K, POINTS, 3) float64
        Samples, and the unit normals of their faces.
    moments : tuple of Moments
        Of each pose's surface.
    """

    def __init__(self, original: MeshAnimation) -> None:
        n = min(len(original), MOST_POSES)
        self.poses = np.unique(np.linspace(0, len(original) - 1, n).round().astype(np.int64))
        first = original[int(self.poses[0])]
        rng = np.random.default_rng(0)
        face, weights = surface_samples(first.points, first.faces, POINTS, rng)
        corners = first.faces[face]
        points, normals, moments = [], [], []
        for k in self.poses:
            V = original[int(k)].points
            points.append(np.einsum("ij,ijk->ik", weights, V[corners]))
            normals.append(normalized(area_vectors(V, corners)))
            moments.append(Moments(V, first.faces))
        self.points, self.normals = np.stack(points), np.stack(normals)
        self.moments = tuple(moments)
        self._trees: dict[int, cKDTree] = {}
        # Mean distance between neighbours.
        self._apart = float(np.sqrt(face_areas(first.points, first.faces).sum() / POINTS))

    def misfit(self, X: FloatArray, at: int) -> float:
        """Measure how far points X (m, 3) are from pose number `at`, the farthest left aside."""
        tree = self._trees.get(at)
        if tree is None:
            tree = self._trees[at] = cKDTree(self.points[at])
        distance, nearest = tree.query(X)
        across = ((X - self.points[at][nearest]) * self.normals[at][nearest]).sum(axis=1)
        beyond = np.maximum(distance - self._apart, 0.0)
        found = np.sqrt(across**2 + beyond**2)
        return float(np.sort(found)[: max(1, int(KEPT * len(found)))].mean())

    def nearest(self, X: FloatArray) -> int:
        """Find the pose that points X (m, 3) in the original's space are nearest to."""
        return int(np.argmin([self.misfit(X, at) for at in range(len(self.poses))]))


class Moments:
    """The centre of a surface, its principal axes and its size, each triangle by its area.

    Parameters
    ----------
    V : (N, 3) float64
    F : (F, 3) int

    Attributes
    ----------
    centre : (3,) float64
    axes : (3, 3) float64
        Columns, the longest first, in no certain direction.
    radius : float
        Root mean square distance from the centre.
    """

    def __init__(self, V: FloatArray, F: IntArray) -> None:
        a, b, c = V[F[:, 0]], V[F[:, 1]], V[F[:, 2]]
        area = lengths(np.cross(b - a, c - a))
        area = area / (area.sum() or 1.0)
        self.centre: FloatArray = area @ ((a + b + c) / 3.0)
        a, b, c = a - self.centre, b - self.centre, c - self.centre
        total = a + b + c
        # The integral of x x' over a triangle of area 1.
        second = sum((p * area[:, None]).T @ p for p in (a, b, c, total)) / 12.0
        self.radius = float(np.sqrt(np.trace(second)))
        self.axes: FloatArray = np.linalg.eigh(second)[1][:, ::-1]


def spread(count: int, most: int) -> Sequence[int]:
    """Choose at most so many of `count` indices, evenly."""
    return [int(i) for i in np.unique(np.linspace(0, count - 1, min(count, most)).round())]
