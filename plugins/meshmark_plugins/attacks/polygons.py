"""Topologies of polygons after vertices went or were renamed."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.topology import Topology, face_adjacency


def restrict(topology: Topology, keep: BoolArray) -> tuple[IntArray, Topology | None]:
    """Keep the polygons all of whose corners are kept, and the vertices they use.

    Parameters
    ----------
    topology : Topology
        Polygons over N points.
    keep : (N,) bool
        Vertices that stay.

    Returns
    -------
    indices : (M,) int
        Old index of each vertex of the result, increasing.
    topology : Topology or None
        The kept polygons over the M vertices; None if no polygon is left.
    """
    owner = np.repeat(np.arange(len(topology.counts)), topology.counts)
    lost = np.bincount(owner, ~keep[topology.indices], len(topology.counts)) > 0
    corners = topology.indices[~lost[owner]]
    if not len(corners):
        return np.empty(0, dtype=np.int64), None
    indices, renamed = np.unique(corners, return_inverse=True)
    kept = Topology(topology.counts[~lost], renamed.reshape(-1), len(indices))
    return indices, kept


def permute(topology: Topology, vertices: IntArray, polygons: IntArray) -> Topology:
    """Rename vertices and put polygons into another order.

    Parameters
    ----------
    topology : Topology
        Polygons over N points.
    vertices : (N,) int
        Permutation: vertex i of the result is vertex `vertices[i]` of the input.
    polygons : (P,) int
        Permutation: polygon i of the result is polygon `polygons[i]` of the input.
    """
    renamed = np.empty_like(vertices)
    renamed[vertices] = np.arange(len(vertices))
    counts = topology.counts[polygons]
    start = (np.cumsum(topology.counts) - topology.counts)[polygons]
    within = np.arange(len(topology.indices)) - np.repeat(np.cumsum(counts) - counts, counts)
    return Topology(
        counts, renamed[topology.indices[np.repeat(start, counts) + within]], topology.n_points
    )


@lru_cache(maxsize=4)
def turn(topology: Topology) -> Topology:
    """Turn polygons inside out; remembered for the topologies used last.

    Each keeps its first corner, about which its triangles fan out, and so the same diagonals.
    """
    start = np.cumsum(topology.counts) - topology.counts
    size = np.repeat(topology.counts, topology.counts)
    start = np.repeat(start, topology.counts)
    within = np.arange(len(topology.indices)) - start
    return Topology(topology.counts, topology.indices[start + (-within) % size], topology.n_points)


def join(topology: Topology, F: IntArray, n_more: int) -> Topology:
    """Put triangles (F, 3) behind the polygons, over `n_more` points behind the old ones."""
    counts = np.concatenate([topology.counts, np.full(len(F), 3)])
    indices = np.concatenate([topology.indices, F.ravel()])
    return Topology(counts, indices, topology.n_points + n_more)


def neighbours(topology: Topology) -> tuple[IntArray, IntArray]:
    """List pairs of polygons that share an edge.

    Returns
    -------
    pairs : (A, 2) int
        Numbers of the polygons.
    shared : (A, 2) int
        The vertices of the shared edge.
    """
    polygon = np.repeat(np.arange(len(topology.counts)), topology.counts - 2)
    triangles, shared = face_adjacency(topology.triangles)
    pairs = polygon[triangles]
    # Triangles of one polygon meet along its diagonals.
    apart = pairs[:, 0] != pairs[:, 1]
    return pairs[apart], shared[apart]


def require_triangles(V: FloatArray, F: IntArray, attack: str) -> tuple[FloatArray, IntArray]:
    """Drop vertices without a triangle and triangles with a repeated corner; insist on some left.

    Raises
    ------
    InputError
        If no triangle is left.
    """
    proper = (F[:, 0] != F[:, 1]) & (F[:, 1] != F[:, 2]) & (F[:, 2] != F[:, 0])
    if not proper.any():
        raise InputError(f"{attack} leaves no face")
    kept, renamed = np.unique(F[proper], return_inverse=True)
    return V[kept], renamed.reshape(-1, 3)
