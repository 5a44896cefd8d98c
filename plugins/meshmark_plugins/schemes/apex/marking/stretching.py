"""What it costs to stretch a surface, and how strongly a displacement stretches it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import face_areas
from meshmark_plugins.schemes.apex.linear_algebra.triangle_energy import strains

# Weight of stretching beside moving, for stretches over a bin.
STRETCHING_WEIGHT = 3.0
# A triangle smaller than the mean one is made stiffer by the ratio of areas, but no more than this.
MAX_SLIVER_WEIGHT = 50.0
# Smallest area, as a share of the mean one, that gradients over a triangle are divided by.
MIN_TRIANGLE_AREA_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class StretchingEnergy:
    """The Dirichlet energy of displacements of a surface, triangle by triangle.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    corner_products : (F, 3) float64
        Inner product of the two sides at each corner, in root areas squared.
    double_areas : (F,) float64
        Twice the area of each triangle, in root areas squared.
    weight : (F,) float64
        What a unit of |grad d|^2 costs in each triangle, by its area.
    """

    F: IntArray
    corner_products: FloatArray
    double_areas: FloatArray
    weight: FloatArray

    def strains(self, d: FloatArray) -> FloatArray:
        """Frobenius norm of the gradient of a displacement (3 N,) in each triangle, (F,)."""
        return strains(self.F, self.corner_products, self.double_areas, d)

    def side_costs(self, factor: FloatArray) -> FloatArray:
        """Cost of moving the ends of each side apart, (F, 3), triangles `factor` times as dear."""
        return 0.5 * self.corner_products * (factor * self.weight / self.double_areas)[:, None]


def stretching_energy(V: FloatArray, F: IntArray, width: float) -> StretchingEnergy:
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
    heavier = np.minimum(mean / np.maximum(areas, 1e-12 * mean), MAX_SLIVER_WEIGHT)
    corner_products = np.empty(F.shape)
    for k in range(3):
        u = V[F[:, (k + 1) % 3]] - V[F[:, k]]
        v = V[F[:, (k + 2) % 3]] - V[F[:, k]]
        corner_products[:, k] = np.einsum("ij,ij->i", u, v) / total
    double_areas = 2.0 * np.maximum(areas, MIN_TRIANGLE_AREA_SHARE * mean) / total
    length = width / (2.0 * np.pi)
    return StretchingEnergy(
        F, corner_products, double_areas, STRETCHING_WEIGHT * length**2 * heavier
    )
