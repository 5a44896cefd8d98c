"""Fits a marked surface to the original one by moves along normals."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import area_vectors, lengths, normalized, vertex_normals
from meshmark_plugins.schemes.apex.linear_algebra.conjugate_gradients import conjugate_gradients

FITTING_ROUNDS = 2
CG_ITERATIONS = 12
CG_TOLERANCE = 1e-6
# Weight of staying, beside that of fitting: vertices that no sample tells apart stay.
FIT_DAMPING = 0.02
# Points of a triangle that are to lie on the original, in barycentric coordinates.
_TRIANGLE_SAMPLES = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 2]]) / 6.0


def fit_to_surface(V: FloatArray, F: IntArray, original: ClosestPoints) -> FloatArray:
    """Fit a surface to another one, moving vertices along their normals only.

    Parameters
    ----------
    V : (N, 3) float64
        Vertices near the original surface.
    F : (F, 3) int
        Triangles.
    original : ClosestPoints
        The surface to lie on.

    Returns
    -------
    (N, 3) float64
        Vertices that slid over a bend cut its corner or stick out of it; these share the error
        between both sides, in the sense of least squares.

    Notes
    -----
    Samples are drawn to the planes of the triangles that they are nearest to [1]_. Small moves
    along normals hardly change which triangles these are, or how moves of vertices move samples.

    References
    ----------
    .. [1] Y. Chen, G. Medioni, "Object modelling by registration of multiple range images", Image
       and Vision Computing 10(3), 1992. doi:10.1016/0262-8856(92)90066-C
    """
    P, M = original.planes(original.faces(_samples(V, F).reshape(-1, 3)))
    P, M = P.reshape(len(F), -1, 3), M.reshape(len(F), -1, 3)
    vectors, normals = area_vectors(V, F), vertex_normals(V, F)
    areas, n = lengths(vectors), normalized(vectors)
    weight = np.maximum(areas, 1e-3 * areas.mean())[:, None] / len(_TRIANGLE_SAMPLES)
    along = np.einsum("fkx,fx->fk", normals[F], n)
    A = _normal_equations(F, weight, along, len(V))
    for _ in range(FITTING_ROUNDS):
        off = np.einsum("fsx,fsx->fs", P - _samples(V, F), M)
        wanted = weight * off * np.einsum("fsx,fx->fs", M, n)
        at_corners = along * (wanted @ _TRIANGLE_SAMPLES)
        b = np.bincount(F.ravel(), at_corners.ravel(), len(V)).astype(np.float64)
        offsets = conjugate_gradients(
            A, b, np.zeros(len(V)), 1.0 / A.diagonal(), CG_ITERATIONS, CG_TOLERANCE
        )
        V = V + offsets[:, None] * normals
    return V


def _samples(V: FloatArray, F: IntArray) -> FloatArray:
    """Spread points over the triangles, (F, 4, 3)."""
    return _TRIANGLE_SAMPLES @ V[F]


def _normal_equations(
    F: IntArray, weight: FloatArray, along: FloatArray, n_points: int
) -> csr_matrix:
    """Assemble the matrix (N, N) of least squares for offsets of vertices along their normals.

    `weight` (F, 1) is that of a sample, `along` (F, 3) how far a triangle's plane moves with each
    corner.
    """
    products = _TRIANGLE_SAMPLES.T @ _TRIANGLE_SAMPLES
    by_corners = weight[:, :, None] * along[:, :, None] * along[:, None, :] * products
    rows, columns = np.repeat(F, 3, axis=1), np.tile(F, 3)
    A = csr_matrix((by_corners.ravel(), (rows.ravel(), columns.ravel())), shape=(n_points,) * 2)
    diagonal = A.diagonal()
    return csr_matrix(A + FIT_DAMPING * diags_array(diagonal + 1e-3 * diagonal.mean()))
