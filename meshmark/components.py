"""The surfaces a mesh is made of: what is connected, what only touches, what was cut apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from meshmark.geometry import lengths, unit
from meshmark.topology import boundary_edges, edges

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Triangles about one edge among which the straightest way on is looked for.
MOST_ABOUT_EDGE = 8
# Points of borders nearer to each other than this share of the edges about them are sewn
# together, each with so many others at most.
SEAM, MOST_SEWN = 0.05, 8


def surface_components(V: FloatArray, F: IntArray) -> IntArray:
    """Label the connected surfaces of a mesh, (F,) int, in the order of their first triangles.

    Two triangles that alone share an edge belong together. Where more meet at an edge, a sheet
    was attached there: of them, the pairs that go on straightest belong together, and a triangle
    that is left over does not.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    """
    pairs = np.concatenate(list(_continuations(V, F)))
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(F), len(F)))
    label = connected_components(graph, directed=False)[1]
    _, first, label = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first, kind="stable")] = np.arange(len(first))
    return rank[label]


def _continuations(V: FloatArray, F: IntArray) -> list[IntArray]:
    """Pair the triangles (A, 2) that go on into each other, by how many meet at their edge."""
    tail, head, apex = F.ravel(), np.roll(F, -1, axis=1).ravel(), np.roll(F, -2, axis=1).ravel()
    low, high = np.minimum(tail, head).astype(np.int64), np.maximum(tail, head).astype(np.int64)
    code = low * (int(F.max(initial=0)) + 1) + high
    order = np.argsort(code, kind="stable")
    _, start, count = np.unique(code[order], return_index=True, return_counts=True)
    found = [np.empty((0, 2), dtype=np.int64)]
    for k in range(2, MOST_ABOUT_EDGE + 1):
        sides = order[start[count == k, None] + np.arange(k)]
        if k == 2:
            found.append(sides // 3)
        elif len(sides):
            found.append(_straightest(V, low[sides], high[sides], apex[sides], sides // 3))
    return found


def _straightest(
    V: FloatArray, low: IntArray, high: IntArray, apex: IntArray, face: IntArray
) -> IntArray:
    """Pair the triangles about edges, all arrays (E, k), the straightest pairs first, (A, 2)."""
    E, k = face.shape
    along = unit(V[high[:, 0]] - V[low[:, 0]])[:, None, :]
    out = V[apex] - V[low]
    out = unit((out - (out * along).sum(axis=2, keepdims=True) * along).reshape(-1, 3))
    one, two = np.triu_indices(k, 1)
    out = out.reshape(E, k, 3)
    straight = -(out[:, one] * out[:, two]).sum(axis=2)
    rows = np.arange(E)
    found = []
    for _ in range(k // 2):
        best = straight.argmax(axis=1)
        onward = straight[rows, best] > 0.0
        taken = np.stack([face[rows, one[best]], face[rows, two[best]]], axis=1)
        found.append(taken[onward])
        used = [one == one[best, None], one == two[best, None]]
        used += [two == one[best, None], two == two[best, None]]
        straight = np.where(np.logical_or.reduce(used), -np.inf, straight)
    return np.concatenate(found)


def seams(V: FloatArray, F: IntArray, tolerance: float = SEAM) -> IntArray:
    """List pairs of border points so near to each other that a cut must have made them, (S, 2).

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions. Exactly coincident ones are listed, too, where they were not welded.
    F : (F, 3) int
        Triangles.
    tolerance : float
        How near, as a share of the mean edge at both points.

    Notes
    -----
    Only borders are looked at: points within a surface may lie as near to each other as they
    like, as those of slivers do. Two ends of one edge are never a pair. A point has at most
    `MOST_SEWN` others.
    """
    border = np.unique(boundary_edges(F))
    if border.size < 2:
        return np.empty((0, 2), dtype=np.int64)
    E = edges(F)
    ends = np.bincount(E.ravel(), minlength=len(V))
    around = np.bincount(E.ravel(), np.repeat(lengths(V[E[:, 0]] - V[E[:, 1]]), 2), len(V))
    reach = tolerance * around[border] / np.maximum(ends[border], 1)
    nearest = min(MOST_SEWN + 1, border.size)
    gap, other = cKDTree(V[border]).query(V[border], nearest, distance_upper_bound=reach.max())
    own = np.repeat(np.arange(border.size), nearest)
    gap, other = gap.ravel(), np.minimum(other.ravel(), border.size - 1)
    near = (gap <= np.minimum(reach[own], reach[other])) & (own < other)
    pairs = np.sort(np.stack([border[own[near]], border[other[near]]], axis=1), axis=1)
    return pairs[~np.isin(pairs @ (len(V), 1), E @ (len(V), 1))]


def sewn(n_points: int, pairs: IntArray) -> IntArray:
    """Name for every point the first of those it is sewn to, itself included, (N,) int."""
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n_points,) * 2)
    label = connected_components(graph, directed=False)[1]
    _, first = np.unique(label, return_index=True)
    return first[label].astype(np.int64)
