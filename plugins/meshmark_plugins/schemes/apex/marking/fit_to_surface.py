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
    """
    # Moves along normals hardly change which triangle of the original is the closest.
    nearest = original.faces(_samples(V, F).reshape(-1, 3))
    for _ in range(FITTING_ROUNDS):
        normals = vertex_normals(V, F)
        V = V + _offsets(V, F, normals, original, nearest)[:, None] * normals
    return V


def _samples(V: FloatArray, F: IntArray) -> FloatArray:
    """Spread points over the triangles, (F, 4, 3)."""
    return _TRIANGLE_SAMPLES @ V[F]


def _offsets(
    V: FloatArray, F: IntArray, normals: FloatArray, original: ClosestPoints, nearest: IntArray
) -> FloatArray:
    n_samples = len(_TRIANGLE_SAMPLES)
    vectors = area_vectors(V, F)
    areas, n = lengths(vectors), normalized(vectors)
    Q = _samples(V, F)
    foot = original.points_in(nearest, Q.reshape(-1, 3)).reshape(Q.shape)
    wanted = np.einsum("fsx,fx->fs", foot - Q, n)
    weight = np.sqrt(np.maximum(areas, 1e-3 * areas.mean()) / n_samples)
    along = np.einsum("fkx,fx->fk", normals[F], n) * weight[:, None]
    values = _TRIANGLE_SAMPLES[None] * along[:, None, :]
    rows = np.repeat(np.arange(len(F) * n_samples), 3)
    columns = np.repeat(F, n_samples, axis=0).ravel()
    M = csr_matrix((values.ravel(), (rows, columns)), shape=(len(F) * n_samples, len(V)))
    A = csr_matrix(M.T @ M)
    diagonal = A.diagonal()
    A = csr_matrix(A + FIT_DAMPING * diags_array(diagonal + 1e-3 * diagonal.mean()))
    b = M.T @ (wanted * weight[:, None]).ravel()
    return conjugate_gradients(
        A, b, np.zeros(len(V)), 1.0 / A.diagonal(), CG_ITERATIONS, CG_TOLERANCE
    )
