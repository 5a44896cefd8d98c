"""Umbrella smoothing: what an attack does to a mesh, and what a mark rehearses."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.topology import Topology, polygon_edges

LAMBDA = 0.1


def umbrella(E: IntArray, border: IntArray, n_points: int) -> csr_matrix:
    """Build the operator that maps V to (mean of neighbours - V).

    Parameters
    ----------
    E : (E, 2) int
        Edges, each once.
    border : (B,) int
        Vertices that stay: the operator's rows are 0 there, as they are off all edges.
    n_points : int
        Number of vertices.

    Returns
    -------
    (N, N) sparse float64
    """
    i, j = np.concatenate([E, E[:, ::-1]]).T
    A = csr_matrix((np.ones(len(i)), (i, j)), shape=(n_points, n_points))
    degree = np.asarray(A.sum(axis=1)).ravel()
    free = degree > 0
    free[border] = False
    rows = np.where(free, 1.0 / np.maximum(degree, 1.0), 0.0)
    return csr_matrix(diags_array(rows) @ A - diags_array(free.astype(np.float64)))


@lru_cache(maxsize=4)
def polygon_umbrella(topology: Topology) -> csr_matrix:
    """Build the umbrella operator along polygon edges; remembered for the topologies used last."""
    E, uses = polygon_edges(topology.counts, topology.indices)
    return umbrella(E, E[uses == 1].ravel(), topology.n_points)


def smooth(V: FloatArray, L: csr_matrix, iterations: int, step: float = LAMBDA) -> FloatArray:
    """Apply V += step L V again and again, all vertices at once, (N, 3)."""
    for _ in range(iterations):
        V = V + step * (L @ V)
    return V
