"""Areas and normals of triangle meshes."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled_beside_others

# Lengths below this count as none: squares of anything shorter would underflow.
TINY = 1e-150
# Triangles with a smaller squared sine of an angle have no plane: rounding decides where it lies.
FLAT = 1e-14


@compiled_beside_others
def area_vectors(V: FloatArray, F: IntArray) -> FloatArray:
    """Compute the normals of triangles, (F, 3) float64, as long as the areas.

    Column by column, which takes a third of the time of numpy's cross product.
    """
    i, j, k = np.ascontiguousarray(F.T)
    x, y, z = np.ascontiguousarray(V.T)
    u = [column[j] - column[i] for column in (x, y, z)]
    v = [column[k] - column[i] for column in (x, y, z)]
    N = np.empty((len(F), 3))
    for axis in range(3):
        one, two = (axis + 1) % 3, (axis + 2) % 3
        N[:, axis] = u[one] * v[two] - u[two] * v[one]
    return 0.5 * N


def lengths(vectors: FloatArray) -> FloatArray:
    """Compute the lengths of vectors (n, 3), (n,) float64.

    Column by column: numpy's norm takes several times as long over axes this short.
    """
    x, y, z = vectors.T
    return np.sqrt(x * x + y * y + z * z)


@compiled_beside_others
def face_areas(V: FloatArray, F: IntArray) -> FloatArray:
    """Compute the areas of triangles, (F,) float64."""
    return lengths(area_vectors(V, F))


def edge_length(V: FloatArray, F: IntArray, quantile: float = 0.5) -> float:
    """Measure a quantile, by default the median, of the lengths of triangles' sides."""
    sides = [lengths(V[F[:, i]] - V[F[:, i - 1]]) for i in range(3)]
    return float(np.quantile(sides, quantile))


def surface_box(V: FloatArray, F: IntArray) -> tuple[float, FloatArray]:
    """Measure the bounding box of a surface, points that no triangle uses left aside.

    Returns
    -------
    diagonal : float
        Its length; 0 without triangles.
    centre : (3,) float64
    """
    used = np.zeros(len(V), dtype=bool)
    used[F.ravel()] = True
    corners = V[used] if len(F) else np.zeros((1, 3))
    # Column by column: a reduction over axes this long takes several times as long.
    low, high = (np.array([end(x) for x in corners.T]) for end in (np.min, np.max))
    return float(np.linalg.norm(high - low)), (low + high) / 2


def vertex_areas(V: FloatArray, F: IntArray) -> FloatArray:
    """Give every vertex a third of the area of each of its triangles, (N,) float64."""
    return sum_at_corners(face_areas(V, F) / 3.0, F, len(V))


def normalized(vectors: FloatArray) -> FloatArray:
    """Scale vectors (n, 3) to length 1; those without length stay 0."""
    length = lengths(vectors)[:, None]
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > TINY)


def sum_at_corners(values: FloatArray, F: IntArray, n_points: int) -> FloatArray:
    """Add the value (F,) or (F, k) of each triangle, or edge, to its corners, (N,) or (N, k)."""
    corners = F.shape[1]
    if values.ndim == 1:
        total = np.bincount(F.ravel(), np.repeat(values, corners), n_points)
        return total.astype(np.float64, copy=False)
    columns = [np.bincount(F.ravel(), np.repeat(v, corners), n_points) for v in values.T]
    return np.stack(columns, axis=1)


@compiled_beside_others
def vertex_normals(V: FloatArray, F: IntArray) -> FloatArray:
    """Compute unit normals of vertices, the mean of their triangles' by area, (N, 3)."""
    return normalized(sum_at_corners(area_vectors(V, F), F, len(V)))
