"""Cuts a surface into patches of about the same area, the same on every machine."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import lengths, vertex_areas
from meshmark.mesh.topology import edges

ROUNDS = 10
# Bits of each coordinate along the curve that fills space.
CURVE_BITS = 10
# Steps of lengths and areas in a mean one, and the most that an edge is lengthened by. Whole
# numbers are added up without rounding errors; those of another library or processor could decide
# between seeds as near to a vertex as each other, of which regular meshes are full.
STEPS, JITTER = 2**24, 2**14


def patch_labels(V: FloatArray, F: IntArray, n_patches: int) -> IntArray:
    """Label each vertex with its patch, by Lloyd's rounds on distances along edges.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    n_patches : int
        How many patches, at most N.

    Returns
    -------
    (N,) int
        0-based; patches are numbered along a curve that fills space, so that patches of
        neighbouring numbers are near to each other.

    References
    ----------
    S. Lloyd, "Least squares quantization in PCM", IEEE Transactions on Information Theory 28(2),
    1982. doi:10.1109/TIT.1982.1056489
    """
    area = _whole(vertex_areas(V, F))
    seeds = _spread_seeds(V, area, n_patches)
    E = edges(F)
    # An edge without length would be no edge to scipy.
    jitter = np.random.default_rng(0).integers(1, JITTER, len(E))
    length = _whole(lengths(V[E[:, 1]] - V[E[:, 0]])) + jitter
    graph = csr_matrix((length, (E[:, 0], E[:, 1])), shape=(len(V), len(V)))
    for _ in range(ROUNDS):
        label = _nearest_seed(graph, V, seeds)
        seeds = _central_vertices(V, area, label, seeds)
    seeds = seeds[np.argsort(_curve_position(V[seeds]), kind="stable")]
    return _nearest_seed(graph, V, seeds)


def _spread_seeds(V: FloatArray, area: FloatArray, n_seeds: int) -> IntArray:
    """Choose vertices at equal steps of area along a curve that fills space."""
    order = np.argsort(_curve_position(V), kind="stable")
    passed = np.cumsum(area[order])
    steps = (np.arange(n_seeds) + 0.5) * passed[-1] / n_seeds
    return np.unique(order[np.minimum(np.searchsorted(passed, steps), len(V) - 1)])


def _nearest_seed(graph: csr_matrix, V: FloatArray, seeds: IntArray) -> IntArray:
    """Find the number of the nearest seed: along edges, or in space where none leads to it."""
    distance, _, source = dijkstra(
        graph, directed=False, indices=seeds, min_only=True, return_predecessors=True
    )
    number = np.full(len(V), -1)
    number[seeds] = np.arange(len(seeds))
    label = number[np.maximum(source, 0)]
    lost = ~np.isfinite(distance)
    if lost.any():
        label[lost] = cKDTree(V[seeds]).query(V[lost])[1]
    return label


def _central_vertices(
    V: FloatArray, area: FloatArray, label: IntArray, seeds: IntArray
) -> IntArray:
    """Move each seed to the vertex of its patch that is nearest to the centre of its area."""
    n = len(seeds)
    weight = np.maximum(area, 1.0)
    mass = np.bincount(label, weight, n)
    centre = np.stack([np.bincount(label, weight * x, n) / mass for x in V.T], axis=1)
    offset = _whole(lengths(V - centre[label]))
    # The first of each patch after sorting by patch, then by distance, then by index.
    order = np.lexsort((offset, label))
    first = np.searchsorted(label[order], np.arange(n))
    return order[first]


def _whole(x: FloatArray) -> FloatArray:
    """Round values to whole numbers, `STEPS` in a mean one."""
    return np.round(x / (x.mean() or 1.0) * STEPS)


def _curve_position(P: FloatArray) -> IntArray:
    """Compute the place of points (n, 3) on Morton's curve through their bounding cube, (n,)."""
    low = P.min(axis=0)
    size = float(np.ptp(P, axis=0).max()) or 1.0
    cell = np.minimum((P - low) / size * 2**CURVE_BITS, 2**CURVE_BITS - 1).astype(np.int64)
    position = np.zeros(len(P), dtype=np.int64)
    for bit in range(CURVE_BITS):
        for axis in range(3):
            position |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return position
