"""Few points of the original in many poses, so that rough searches need not read it again."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.closest_points import surface_samples
from meshmark.mesh.geometry import area_vectors, face_areas, lengths, normalized, surface_box

MOST_POSES, POINTS = 64, 2000
# Share of the diagonal beyond which all points are equally far.
FAR = 0.05


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
        self._trees: dict[int, Any] = {}
        # Mean distance between neighbours: what is nearer to a sample may lie on the surface.
        self._apart = float(np.sqrt(face_areas(first.points, first.faces).sum() / POINTS))
        self._far = FAR * surface_box(first.points, first.faces)[0]

    def may_hold(self, X: FloatArray, share: float) -> bool:
        """Tell whether a share of points (m, 3) lie in the box of all poses, or near to it."""
        flat = self.points.reshape(-1, 3)
        low, high = flat.min(axis=0) - self._far, flat.max(axis=0) + self._far
        inside = ((low < X) & (high > X)).all(axis=1)
        return bool(len(X) > 0 and inside.mean() >= share)

    def misfit(self, X: FloatArray, at: int) -> float:
        """Measure how far points X (m, 3) are from pose number `at`, in the mean."""
        return float(self.misfits(X[None], at)[0])

    def misfits(self, X: FloatArray, at: int) -> FloatArray:
        """Measure how far the points of each placement X (k, m, 3) are from a pose, (k,)."""
        tree = self._trees.get(at)
        if tree is None:
            tree = self._trees[at] = cKDTree(self.points[at])
        Q = X.reshape(-1, 3)
        distance, nearest = tree.query(Q, distance_upper_bound=self._far + self._apart)
        found = np.full(len(Q), self._far)
        near = np.flatnonzero(np.isfinite(distance))
        nearest, distance = nearest[near], distance[near]
        across = ((Q[near] - self.points[at][nearest]) * self.normals[at][nearest]).sum(axis=1)
        beyond = np.maximum(distance - self._apart, 0.0)
        found[near] = np.minimum(np.sqrt(across**2 + beyond**2), self._far)
        means: FloatArray = found.reshape(X.shape[:2]).mean(axis=1)
        return means

    def blend(self, pose: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Blend the two sampled poses about a pose linearly.

        Returns
        -------
        points, normals, motion : (POINTS, 3) float64
            Motion is the derivative of the points by the pose.
        """
        if len(self.poses) == 1:
            return self.points[0], self.normals[0], np.zeros_like(self.points[0])
        at = int(np.clip(np.searchsorted(self.poses, pose, "right") - 1, 0, len(self.poses) - 2))
        gap = float(self.poses[at + 1] - self.poses[at])
        share = (pose - self.poses[at]) / gap
        low, high = self.points[at], self.points[at + 1]
        normals = (1.0 - share) * self.normals[at] + share * self.normals[at + 1]
        return (1.0 - share) * low + share * high, normalized(normals), (high - low) / gap

    def nearest(self, X: FloatArray, count: int) -> list[float]:
        """List so many poses that points X (m, 3) in the original's space are nearest to."""
        misfits = np.array([self.misfit(X, at) for at in range(len(self.poses))])
        return [float(k) for k in self.poses[np.argsort(misfits, kind="stable")[:count]]]


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
