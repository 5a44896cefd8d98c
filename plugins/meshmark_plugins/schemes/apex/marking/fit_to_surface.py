"""Fits a marked surface to the original one by moves along normals."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import area_vectors, face_areas, normalized, vertex_normals
from meshmark.mesh.surface_walk import WALK_TOLERANCE
from meshmark_plugins.schemes.apex.linear_algebra.conjugate_gradients import conjugate_gradients

CG_ITERATIONS = 8
CG_TOLERANCE = 1e-6
# Weight of staying, beside that of fitting: vertices that no sample tells apart stay.
FIT_DAMPING = 0.02
# Points of a triangle that are to lie on the original, in barycentric coordinates.
_TRIANGLE_SAMPLES = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4]]) / 6.0


def fit_to_surface(
    V: FloatArray, F: IntArray, original: ClosestPoints, near: IntArray
) -> FloatArray:
    """Fit a surface to another one, moving vertices along their normals only.

    Parameters
    ----------
    V : (N, 3) float64
        Vertices near the original surface.
    F : (F, 3) int
        Triangles.
    original : ClosestPoints
        The surface to lie on.
    near : (N,) int
        Triangle of the original that each vertex is about nearest to: where walks start.

    Returns
    -------
    (N, 3) float64
        Vertices that slid over a bend cut its corner or stick out of it; these share the error
        between both sides, in the sense of least squares.

    Notes
    -----
    Samples are drawn to the planes of the triangles that they are nearest to [1]_. Small moves
    along normals hardly change which triangles these are.

    References
    ----------
    .. [1] Y. Chen, G. Medioni, "Object modelling by registration of multiple range images", Image
       and Vision Computing 10(3), 1992. doi:10.1016/0262-8856(92)90066-C
    """
    samples = points_of_triangles(V, F, _TRIANGLE_SAMPLES)
    # Without a limit, 2.5 % of the cow's vertices were held back, not .2.
    tolerance = WALK_TOLERANCE * np.sqrt(face_areas(V, F)).repeat(len(_TRIANGLE_SAMPLES))
    # Each sample is nearest to one corner.
    face = original.faces_near(samples.reshape(-1, 3), near[F.ravel()], tolerance)
    return fitted_to_planes(
        V,
        F,
        _TRIANGLE_SAMPLES,
        original.V,
        original.F,
        face.reshape(samples.shape[:2]),
        FIT_DAMPING,
        CG_ITERATIONS,
        CG_TOLERANCE,
    )


@compiled
def points_of_triangles(V: FloatArray, F: IntArray, weights: FloatArray) -> FloatArray:
    """Compute points of all triangles, (F, S, 3), by barycentric coordinates (S, 3)."""
    return np.einsum("sk,fkx->fsx", weights, V[F])


@compiled
def fitted_to_planes(
    V: FloatArray,
    F: IntArray,
    samples: FloatArray,
    V0: FloatArray,
    F0: IntArray,
    face: IntArray,
    damping: float,
    iterations: int,
    tolerance: float,
) -> FloatArray:
    """Move vertices (N, 3) along their normals, so that samples are drawn to planes.

    Parameters
    ----------
    samples : (S, 3) float64
        Barycentric coordinates.
    V0, F0 : (M, 3) float64, (G, 3) int
        Vertices and triangles of another surface.
    face : (F, S) int
        The triangle whose plane each sample is drawn to; nowhere by one without area.
    damping : float
        Weight of staying, beside that of fitting.
    iterations, tolerance
        Of conjugate gradients.
    """
    areas, normals = face_areas(V, F), vertex_normals(V, F)
    weight = np.maximum(areas, 1e-3 * areas.mean())
    P, M = V0[F0[face, 0]], normalized(area_vectors(V0, F0))[face]
    off = np.einsum("fsx,fsx->fs", P - samples @ V[F], M)
    # How far each sample moves towards its plane with each corner.
    rates = (M @ normals[F].swapaxes(1, 2)) * samples
    weighted = weight[:, None, None] * rates
    b = np.bincount(F.ravel(), np.einsum("fsk,fs->fk", weighted, off).ravel(), len(V)).astype(
        np.float64
    )
    blocks = np.einsum("fsk,fsj->fkj", weighted, rates)
    rows, columns = np.repeat(F, 3, axis=1), np.tile(F, 3)
    A = csr_matrix((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(len(V),) * 2)
    diagonal = A.diagonal()
    stay = damping * (diagonal + 1e-3 * diagonal.mean())
    A = csr_matrix(A + diags_array(stay))
    x = np.zeros(len(V))
    x = conjugate_gradients(A, b, x, 1.0 / (diagonal + stay), iterations, tolerance)
    return V + x[:, None] * normals
