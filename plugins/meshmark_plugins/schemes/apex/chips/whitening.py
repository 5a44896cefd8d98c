"""How densely vertices lie on a surface, smoothed over a given length."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import lengths, vertex_areas
from meshmark_plugins.schemes.apex.linear_algebra.conjugate_gradients import solve

ITERATIONS = 60
TOLERANCE = 1e-7
# Cotangents beyond this belong to slivers, where they say nothing about diffusion.
STEEPEST = 5.0
# Share of the mean vertex area that every vertex is given at least.
LEAST_AREA = 1e-3


def cotangent_weights(V: FloatArray, F: IntArray) -> FloatArray:
    """Half the cotangent of each corner, (F, 3) float64, bounded and not negative."""
    weights = np.empty(F.shape)
    for k in range(3):
        u = V[F[:, (k + 1) % 3]] - V[F[:, k]]
        v = V[F[:, (k + 2) % 3]] - V[F[:, k]]
        across = lengths(np.cross(u, v))
        along = np.einsum("ij,ij->i", u, v)
        cot = np.divide(along, across, out=np.full(len(F), STEEPEST), where=across > 0.0)
        weights[:, k] = np.clip(0.5 * cot, 0.0, STEEPEST)
    return weights


def stiffness(F: IntArray, weights: FloatArray, n_points: int) -> csr_matrix:
    """Assemble the Laplacian sum of w |x_i - x_j|^2 over the sides of all triangles.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    weights : (F, 3) float64
        Weight of the side opposite to each corner.
    n_points : int
        N.

    Returns
    -------
    (N, N) sparse float64
        Symmetric, rows summing to 0.
    """
    i = np.concatenate([F[:, 1], F[:, 2], F[:, 0]])
    j = np.concatenate([F[:, 2], F[:, 0], F[:, 1]])
    w = weights.T.ravel()
    A = csr_matrix((w, (i, j)), shape=(n_points, n_points))
    A = csr_matrix(A + A.T)
    return csr_matrix(diags_array(np.asarray(A.sum(axis=1)).ravel()) - A)


def whitening(V: FloatArray, F: IntArray, root_area: float, length: float) -> FloatArray:
    """Weight of each vertex that makes the weighted density even on the scale of `length`.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    root_area : float
        Square root of the surface's area.
    length : float
        Diffusion length, in root areas.

    Returns
    -------
    (N,) float64
        1 / y, where (M + length^2 L) y = 1: one unit of mass a vertex, spread over the
        surface. Sums to about 1.
    """
    areas = vertex_areas(V, F) / root_area**2
    areas = np.maximum(areas, LEAST_AREA * areas.mean())
    A = csr_matrix(diags_array(areas) + length**2 * stiffness(F, cotangent_weights(V, F), len(V)))
    n = len(V)
    y = solve(A, np.ones(n), np.full(n, float(n)), 1.0 / A.diagonal(), ITERATIONS, TOLERANCE)
    return 1.0 / np.maximum(y, 1e-9 * n)
