"""What it costs to stretch a surface, and how strongly a displacement stretches it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import face_areas
from meshmark_plugins.schemes.apex.linear_algebra.laplacian import stiffness

# Weight of stretching beside moving, for stretches over a bin.
STIFFNESS = 3.0
# A triangle of a mean area's share below 1 / SLIVER is no stiffer than that.
SLIVER = 50.0
# Smallest area, as a share of the mean one, that slopes over a triangle are divided by.
LEAST_AREA = 1e-3


@dataclass(frozen=True, eq=False)
class Stretching:
    """The cost of stretching a surface, triangle by triangle.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    along : (F, 3) float64
        Inner product of the two sides at each corner, in root areas squared.
    across : (F,) float64
        Twice the area of each triangle, in root areas squared.
    weight : (F,) float64
        What a unit of |grad d|^2 costs in each triangle, by its area.
    n_points : int
        N.
    """

    F: IntArray
    along: FloatArray
    across: FloatArray
    weight: FloatArray
    n_points: int

    def strains(self, d: FloatArray) -> FloatArray:
        """Frobenius norm of the gradient of a displacement (3 N,) in each triangle, (F,)."""
        moves = d.reshape(-1, 3)[self.F]
        square = np.zeros(len(self.F))
        for k in range(3):
            change = moves[:, (k + 2) % 3] - moves[:, (k + 1) % 3]
            square += self.along[:, k] * np.einsum("fx,fx->f", change, change)
        return np.sqrt(np.maximum(square, 0.0)) / self.across

    def matrix(self, factor: FloatArray | float = 1.0) -> csr_matrix:
        """Assemble the cost (N, N), each triangle made `factor` times as dear."""
        by_corner = 0.5 * self.along * (factor * self.weight / self.across)[:, None]
        return stiffness(self.F, by_corner, self.n_points)


def stretching_cost(V: FloatArray, F: IntArray, width: float) -> Stretching:
    """Cost of stretching: the sum over triangles of |grad d|^2, for stretches over a bin.

    Each triangle counts with the mean area: a sliver folds as easily as any other triangle, so
    that stretching it must not be cheaper.

    Parameters
    ----------
    V : (N, 3) float64
        Positions.
    F : (F, 3) int
        Triangles.
    width : float
        Width of a bin, in root areas.
    """
    areas = face_areas(V, F)
    total, mean = areas.sum(), areas.mean()
    heavier = np.minimum(mean / np.maximum(areas, 1e-12 * mean), SLIVER)
    along = np.empty(F.shape)
    for k in range(3):
        u = V[F[:, (k + 1) % 3]] - V[F[:, k]]
        v = V[F[:, (k + 2) % 3]] - V[F[:, k]]
        along[:, k] = np.einsum("ij,ij->i", u, v) / total
    across = 2.0 * np.maximum(areas, LEAST_AREA * mean) / total
    length = width / (2.0 * np.pi)
    return Stretching(F, along, across, STIFFNESS * length**2 * heavier, len(V))
