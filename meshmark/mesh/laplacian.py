"""Laplacians of triangle meshes: cotangent weights, and the matrix of any weights."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray

# Cotangents beyond this belong to slivers, where they say nothing about diffusion.
MAX_COTANGENT = 5.0


def cotangent_weights(V: FloatArray, F: IntArray) -> FloatArray:
    """Half the cotangent of the angle at each corner, (F, 3) float64, bounded and not negative.

    References
    ----------
    U. Pinkall, K. Polthier, "Computing discrete minimal surfaces and their conjugates",
    Experimental Mathematics 2(1), 1993. doi:10.1080/10586458.1993.10504266
    """
    # Column by column: rows this short take ten times as long.
    corners = [np.array([x[corner] for x in V.T]) for corner in F.T]
    sides = [corners[k - 1] - corners[k - 2] for k in range(3)]
    (ux, uy, uz), (vx, vy, vz) = sides[:2]
    across = np.sqrt((uy * vz - uz * vy) ** 2 + (uz * vx - ux * vz) ** 2 + (ux * vy - uy * vx) ** 2)
    weights = np.empty(F.shape)
    for k in range(3):
        (ux, uy, uz), (vx, vy, vz) = sides[k - 1], sides[k - 2]
        along = -(ux * vx + uy * vy + uz * vz)
        cot = np.divide(along, across, out=np.full(len(F), MAX_COTANGENT), where=across > 0.0)
        weights[:, k] = np.clip(0.5 * cot, 0.0, MAX_COTANGENT)
    return weights


def stiffness_matrix(F: IntArray, weights: FloatArray, n_points: int) -> csr_matrix:
    """Assemble the matrix L with x^T L x = sum of w |x_i - x_j|^2 over the sides of triangles.

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
