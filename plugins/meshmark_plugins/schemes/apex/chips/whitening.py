"""How densely vertices lie on a surface, smoothed over a given length."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import vertex_areas
from meshmark_plugins.schemes.apex.linear_algebra.conjugate_gradients import solve
from meshmark_plugins.schemes.apex.linear_algebra.laplacian import cotangent_weights, stiffness

ITERATIONS = 60
TOLERANCE = 1e-7
# Share of the mean vertex area that every vertex is given at least.
LEAST_AREA = 1e-3


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
