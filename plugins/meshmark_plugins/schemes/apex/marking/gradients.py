"""How distances and chips change when vertices slide, to first order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix, vstack

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.geometry import area_vectors, lengths, normalized, sum_at_corners
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField


def distance_directions(field: GeodesicField) -> FloatArray:
    """Compute unit vectors at vertices along which distance from each anchor grows, (m, n, 3).

    Shorter than 1 where the triangles about a vertex disagree, as at the anchor and where paths
    from two sides meet.
    """
    return growth_directions(field.V, field.component.faces, field.H)


@compiled
def growth_directions(V: FloatArray, F: IntArray, H: FloatArray) -> FloatArray:
    """Average unit gradients of functions H (m, n) over the triangles at vertices, (m, n, 3)."""
    vectors = area_vectors(V, F)
    areas = lengths(vectors)
    normals = normalized(vectors)
    opposite = [np.cross(normals, V[F[:, k - 1]] - V[F[:, k - 2]]) for k in range(3)]
    about = np.maximum(sum_at_corners(areas, F, len(V)), 1e-300)[:, None]
    directions = []
    for h in H:
        slope = normalized(sum(h[F[:, k], None] * opposite[k] for k in range(3)))
        directions.append(sum_at_corners(areas[:, None] * slope, F, len(V)) / about)
    return np.array(directions)


def slide_field(field: GeodesicField, V: FloatArray) -> GeodesicField:
    """Update distances from the anchors for vertices that have slid a little, to V (n, 3).

    To first order: vertices slide by a tenth of a bin or so, over which the way from an anchor
    hardly turns, and measuring anew takes ten times as long.
    """
    moves = V - field.V
    change = np.einsum("mnx,nx->mn", distance_directions(field), moves)
    return replace(field, V=V, H=np.maximum(field.H + change / field.length_scale, 0.0))


def chip_jacobian(
    field: GeodesicField,
    directions: FloatArray,
    weights: FloatArray,
    width: float,
    n_bins: int,
    n_points: int,
) -> csr_matrix:
    """Differentiate chips by vertex positions.

    Parameters
    ----------
    field : Neighbourhood
        A component of m anchors.
    directions : (m, n, 3) float64
        Directions in which the distance from each anchor grows, in the coordinates of the moves.
    weights : (n,) float64
        Whitening weights of its vertices.
    width : float
        Width of a bin, in the length scale of distances.
    n_bins : int
        K.
    n_points : int
        N, vertices of the whole mesh.

    Returns
    -------
    (m K, 3 N) sparse float64
        Change of each chip, anchor after anchor, by a move of each coordinate in lengths of the
        mesh. Moves are taken to keep to the surface, and weights to stay.
    """
    rows = [
        _rows(field, H, direction, weights, width, n_bins, n_points)
        for H, direction in zip(field.H, directions, strict=True)
    ]
    return csr_matrix(vstack(rows, format="csr"))


def _rows(
    field: GeodesicField,
    H: FloatArray,
    direction: FloatArray,
    weights: FloatArray,
    width: float,
    n_bins: int,
    n_points: int,
) -> csr_matrix:
    x = H / width - 1.0
    # What is far beyond the last bin would be beyond the integers, too.
    k = np.floor(np.minimum(x, n_bins)).astype(np.int64)
    inside = np.flatnonzero((k >= 0) & (k < n_bins))
    k, u = k[inside], (x - k)[inside]
    share = weights[inside] / np.bincount(k, weights[inside], n_bins)[k]
    # d/du of the kernel -sin(2 pi u), over the bin's width in lengths of the mesh.
    slope = -2.0 * np.pi * np.cos(2.0 * np.pi * u) / (width * field.length_scale)
    values = (share * slope)[:, None] * direction[inside]
    columns = 3 * field.component.vertices[inside][:, None] + np.arange(3)
    return csr_matrix(
        (values.ravel(), (np.repeat(k, 3), columns.ravel())), shape=(n_bins, 3 * n_points)
    )
