"""The surfaces a mesh is made of: what is connected, what only touches, what was cut apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import lengths, normalized
from meshmark.mesh.topology import boundary_edges, edges, graph_components

# Triangles about one edge among which the straightest way on is looked for.
MOST_ABOUT_EDGE = 8
# Points of borders nearer to each other than this share of the edges about them are sewn
# together, each with so many others at most.
SEAM, MOST_SEWN = 0.3, 8


def surface_components(V: FloatArray, F: IntArray) -> IntArray:
    """Label the connected surfaces of a mesh, (F,) int, in the order of their first triangles.

    Two triangles that alone share an edge belong to one patch. Where more meet, something was
    attached: of the patches that meet along the same edges, two belong together if for most of
    that length it is from one to the other that the surface goes on straightest.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    """
    about = _about_edges(F)
    patch = graph_components(about.pop(2).face, len(F)) if 2 in about else np.arange(len(F))
    links = [_links(V, sides, patch) for sides in about.values()]
    if links:
        patch = graph_components(np.concatenate(links), int(patch.max()) + 1)[patch]
    return patch


@dataclass(frozen=True, eq=False)
class _Sides:
    """The triangles about E edges, k about each.

    Parameters
    ----------
    low, high : (E,) int
        The ends of the edges.
    apex, face : (E, k) int
        The third corner of each triangle, and which triangle it is.
    """

    low: IntArray
    high: IntArray
    apex: IntArray
    face: IntArray


def _about_edges(F: IntArray) -> dict[int, _Sides]:
    """List the triangles about edges, by how many they are: from 2 to `MOST_ABOUT_EDGE`."""
    tail, head, apex = F.ravel(), np.roll(F, -1, axis=1).ravel(), np.roll(F, -2, axis=1).ravel()
    low, high = np.minimum(tail, head).astype(np.int64), np.maximum(tail, head).astype(np.int64)
    code = low * (int(F.max(initial=0)) + 1) + high
    order = np.argsort(code, kind="stable")
    start = np.flatnonzero(np.diff(code[order], prepend=-1))
    count = np.diff(start, append=len(order))
    found: dict[int, _Sides] = {}
    for k in range(2, MOST_ABOUT_EDGE + 1):
        sides = order[start[count == k, None] + np.arange(k)]
        if len(sides):
            found[k] = _Sides(low[sides[:, 0]], high[sides[:, 0]], apex[sides], sides // 3)
    return found


def _links(V: FloatArray, sides: _Sides, patch: IntArray) -> IntArray:
    """Pair the patches (L, 2) that go on into each other across edges where more than two meet."""
    along = V[sides.high] - V[sides.low]
    met = np.sort(patch[sides.face], axis=1)
    _, kind = np.unique(met, axis=0, return_inverse=True)
    kind = kind.reshape(-1)
    length = lengths(along)
    total = np.bincount(kind, length)
    edge, pairs = _straightest(V, sides, normalized(along))
    voted = np.column_stack([kind[edge], np.sort(patch[pairs], axis=1)])
    choice, of = np.unique(voted, axis=0, return_inverse=True)
    votes = np.bincount(of.reshape(-1), length[edge], len(choice))
    return choice[votes >= 0.5 * total[choice[:, 0]], 1:]


def _straightest(V: FloatArray, sides: _Sides, along: FloatArray) -> tuple[IntArray, IntArray]:
    """Pair the triangles about each edge, the straightest pair first.

    Returns
    -------
    edge : (A,) int
        Which edge.
    pairs : (A, 2) int
        The two triangles.
    """
    E, k = sides.face.shape
    out = V[sides.apex] - V[sides.low][:, None]
    out -= (out * along[:, None]).sum(axis=2, keepdims=True) * along[:, None]
    out = normalized(out.reshape(-1, 3)).reshape(E, k, 3)
    one, two = np.triu_indices(k, 1)
    straight = -(out[:, one] * out[:, two]).sum(axis=2)
    rows = np.arange(E)
    edge, pairs = [], []
    for _ in range(k // 2):
        best = straight.argmax(axis=1)
        onward = straight[rows, best] > 0.0
        a, b = one[best], two[best]
        edge.append(rows[onward])
        pairs.append(np.stack([sides.face[rows, a], sides.face[rows, b]], axis=1)[onward])
        a, b = a[:, None], b[:, None]
        straight[(one == a) | (one == b) | (two == a) | (two == b)] = -np.inf
    return np.concatenate(edge), np.concatenate(pairs)


def seams(V: FloatArray, F: IntArray) -> IntArray:
    """List pairs of border points so near to each other that a cut must have made them, (S, 2).

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions. Exactly coincident ones are listed, too, where they were not welded.
    F : (F, 3) int
        Triangles.

    Notes
    -----
    Only borders are looked at: points within a surface may lie as near to each other as they
    like, as those of slivers do. Near is nearer than the share `SEAM` of the mean edge at each of
    the two. Two ends of one edge are never a pair. A point has at most
    `MOST_SEWN` others.
    """
    border = np.unique(boundary_edges(F))
    if border.size < 2:
        return np.empty((0, 2), dtype=np.int64)
    E = edges(F)
    ends = np.bincount(E.ravel(), minlength=len(V))
    around = np.bincount(E.ravel(), np.repeat(lengths(V[E[:, 0]] - V[E[:, 1]]), 2), len(V))
    reach = SEAM * around[border] / np.maximum(ends[border], 1)
    nearest = min(MOST_SEWN + 1, border.size)
    gap, other = cKDTree(V[border]).query(V[border], nearest, distance_upper_bound=reach.max())
    own = np.repeat(np.arange(border.size), nearest)
    gap, other = gap.ravel(), np.minimum(other.ravel(), border.size - 1)
    near = (gap <= np.minimum(reach[own], reach[other])) & (own < other)
    pairs = np.sort(np.stack([border[own[near]], border[other[near]]], axis=1), axis=1)
    return pairs[~np.isin(pairs @ (len(V), 1), E @ (len(V), 1))]


def sewn(n_points: int, pairs: IntArray) -> IntArray:
    """Name for every point the first of those it is sewn to, itself included, (N,) int."""
    label = graph_components(pairs, n_points)
    _, first = np.unique(label, return_index=True)
    return first[label].astype(np.int64)
