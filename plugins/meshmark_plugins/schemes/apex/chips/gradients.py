"""How distances and chips change when vertices slide, to first order."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, Int32Array, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.geometry import (
    area_vectors,
    face_areas,
    lengths,
    normalized,
    sum_at_corners,
)
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField
from meshmark_plugins.schemes.apex.chips.radial_histogram import TRIANGLE_SAMPLES
from meshmark_plugins.schemes.apex.chips.soft_chips import chip_kernel


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


@compiled
def carried_changes(
    directions: FloatArray, G: FloatArray, moves: FloatArray, length_scale: float
) -> tuple[FloatArray, FloatArray]:
    """Tell how distances change when vertices of the reference pose move.

    Parameters
    ----------
    directions : (m, n, 3) float64
        Directions in a pose along which distances grow.
    G : (n, 3, 3) float64
        Carry moves of the reference pose into this one.
    moves : (n, 3) float64
        Moves in this pose.
    length_scale : float
        Length in which distances are given.

    Returns
    -------
    slopes : (m, n, 3) float64
        Derivatives of distances by moves in the reference pose.
    change : (m, n) float64
        How far distances change by `moves`.
    """
    slopes = np.einsum("nxy,mnx->mny", G, directions, optimize=True) / length_scale
    return slopes, np.einsum("mnx,nx->mn", directions, moves) / length_scale


def surface_means(
    V: FloatArray, F: IntArray, H: FloatArray, width: float, n_bins: int
) -> FloatArray:
    """Mean of `chip_kernel` over the area in each bin, (m, K), from distances H (m, n)."""
    areas = face_areas(V, F) / len(TRIANGLE_SAMPLES)
    return sampled_means(areas, F, H, TRIANGLE_SAMPLES, float(width), n_bins)


@compiled
def sampled_means(
    areas: FloatArray, F: IntArray, H: FloatArray, samples: FloatArray, width: float, n_bins: int
) -> FloatArray:
    """Do what `surface_means` does, at samples (s, 3) of triangles, each of an area (F,)."""
    areas = np.repeat(areas, len(samples))
    means = []
    for row in H:
        inside, k, u = _bins((row[F] @ samples.T).ravel(), width, n_bins)
        means.append(_means(k, areas[inside], chip_kernel(u), n_bins))
    return np.array(means)


def vertex_chips(
    H: FloatArray,
    slopes: FloatArray,
    prolongation: csr_matrix,
    weights: FloatArray,
    width: float,
    n_bins: int,
) -> tuple[FloatArray, FloatArray, csr_matrix]:
    """Measure the vertices' part of chips, and differentiate it by moves of what is displaced.

    Parameters
    ----------
    H : (m, n) float64
        Distances from each anchor of the vertices of what is displaced, the mesh or a proxy of it.
    slopes : (m, n, 3) float64
        How they change as these vertices move.
    prolongation : (N, n) sparse float64
        Barycentric coordinates of the mesh's vertices in triangles of what is displaced.
    weights : (N,) float64
        Whitening weights of the mesh's vertices, which moves are taken not to change.
    width : float
        Width of a bin, in the length scale of distances.
    n_bins : int
        K.

    Returns
    -------
    means : (m, K) float64
        Weighted mean of `chip_kernel` over the mesh's vertices in each bin.
    counts : (m, K) float64
        Effective number of vertices, as of `measure_chips`.
    J : (m K, 3 n) sparse float64
        Derivatives of the means. The entries of a row come in threes, of the columns 3 v, 3 v + 1
        and 3 v + 2 of one vertex after another.
    """
    P = prolongation
    means, counts, start, columns, values = chip_rates(
        H, slopes, P.indptr, P.indices, P.data, weights, float(width), n_bins
    )
    shape = (means.size, 3 * H.shape[1])
    return means, counts, csr_matrix((values, columns, start), shape)


@compiled
def chip_rates(
    H: FloatArray,
    slopes: FloatArray,
    start: IntArray,
    corners: IntArray,
    shares: FloatArray,
    weights: FloatArray,
    width: float,
    n_bins: int,
) -> tuple[FloatArray, FloatArray, Int32Array, Int32Array, FloatArray]:
    """Do what `vertex_chips` does with and to sparse matrices.

    Parameters
    ----------
    H, slopes, weights, width, n_bins
        See `vertex_chips`.
    start, corners, shares
        The rows of the prolongation.

    Returns
    -------
    means, counts : (m, K) float64
        See `vertex_chips`.
    start, columns, values
        The rows of J.
    """
    shape = (len(weights), H.shape[1])
    prolongation = csr_matrix((shares, corners, start), shape)
    means, counts, columns, values, sizes = [], [], [], [], [np.zeros(1, dtype=np.int64)]
    for h, slope in zip(H, slopes, strict=True):
        inside, k, u = _bins(prolongation @ h, width, n_bins)
        w = weights[inside]
        total = np.bincount(k, w, n_bins)
        means.append(_means(k, w, chip_kernel(u), n_bins))
        squares = np.bincount(k, w**2, n_bins)
        counts.append(np.divide(total**2, squares, out=np.zeros(n_bins), where=squares > 0.0))
        # d/du of the kernel -sin(2 pi u), over the bin's width.
        change = w / total[k] * (-2.0 * np.pi / width) * np.cos(2.0 * np.pi * u)
        by_vertex = csr_matrix((change, (k, inside)), shape=(n_bins, len(weights)))
        by_distance = csr_matrix(by_vertex @ prolongation)
        by_distance.sort_indices()
        vertices = by_distance.indices
        columns.append((3 * vertices[:, None] + np.arange(3, dtype=np.int32)).ravel())
        values.append((by_distance.data[:, None] * slope[vertices]).ravel())
        sizes.append(3 * np.diff(by_distance.indptr))
    starts = np.cumsum(np.concatenate(sizes)).astype(np.int32)
    joined = np.concatenate(columns).astype(np.int32, copy=False)
    return np.array(means), np.array(counts), starts, joined, np.concatenate(values)


def _bins(H: FloatArray, width: float, n_bins: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Which distances (N,) lie in bins, in which of them each, and at what fraction of it."""
    x = H / width - 1.0
    # What is far beyond the last bin would be beyond the integers, too.
    k = np.floor(np.minimum(x, n_bins)).astype(np.int64)
    inside = np.flatnonzero((k >= 0) & (k < n_bins))
    k = k[inside]
    return inside, k, x[inside] - k


def _means(k: IntArray, weights: FloatArray, values: FloatArray, n_bins: int) -> FloatArray:
    """Weighted mean of values in each bin, (K,); 0 in an empty one."""
    total = np.bincount(k, weights, n_bins)
    sums = np.bincount(k, weights * values, n_bins)
    return np.divide(sums, total, out=np.zeros(n_bins), where=total > 0.0)
