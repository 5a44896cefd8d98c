"""How vertices move: along an edge to the neighbour farthest from, or nearest to, the cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.mesh.flip_guard import face_normals


@dataclass(frozen=True, eq=False)
class EdgeSlopes:
    """The neighbour each vertex would move towards, and what a whole edge would change.

    Parameters
    ----------
    neighbour : (n,) int
        Index of the neighbour; the vertex itself where there is none in that direction.
    gain : (n,) float64
        Change of the distance along the whole edge, never negative.
    """

    neighbour: IntArray
    gain: FloatArray


def extreme_neighbours(d: FloatArray, E: IntArray, upward: BoolArray) -> EdgeSlopes:
    """Find each vertex's one-ring neighbour with the longest (or the shortest) distance.

    Parameters
    ----------
    d : (n,) float64
        Distance of each vertex.
    E : (e, 2) int
        Edges, each once.
    upward : (n,) bool
        Whether a vertex looks for the longest (True) or the shortest distance.
    """
    sign = np.where(upward, 1.0, -1.0)
    start = np.concatenate([E[:, 0], E[:, 1]])
    end = np.concatenate([E[:, 1], E[:, 0]])
    gain = sign[start] * (d[end] - d[start])
    order = np.lexsort((end, -gain, start))
    first = np.concatenate([[True], start[order][1:] != start[order][:-1]])
    chosen = order[first]
    neighbour, best = np.arange(len(d)), np.zeros(len(d))
    rising = chosen[gain[chosen] > 0.0]
    neighbour[start[rising]] = end[rising]
    best[start[rising]] = gain[rising]
    return EdgeSlopes(neighbour, best)


def share_out(
    needed: FloatArray, bins: IntArray, available: FloatArray, turn: FloatArray, picks: int
) -> FloatArray:
    """Take what each bin needs from its vertices, pick by pick.

    The published rule picks a vertex, moves it by some quantity, looks whether the set's mean
    has passed the threshold, and goes on. Here every vertex of a set is picked once, in the
    order of their turns, before any is picked again; for all picks at once, that is a running
    sum.

    Parameters
    ----------
    needed : (K,) float64
        Sum of changes each bin needs, not negative.
    bins : (n,) int
        Bin of each vertex, -1 for none.
    available : (n,) float64
        Largest change each vertex can give.
    turn : (n,) float64
        Order of the picks: within a bin, the lowest comes first.
    picks : int
        How often a vertex is picked until it has given all it can.

    Returns
    -------
    (n,) float64
        Change taken from each vertex.
    """
    n = len(bins)
    pick = np.repeat(np.arange(picks), n)
    k = np.tile(bins, picks)
    order = np.lexsort((np.tile(turn, picks), pick, k))
    order = order[k[order] >= 0]
    taken = np.zeros(n * picks)
    if order.size:
        k, give = k[order], np.tile(available / picks, picks)[order]
        before = np.cumsum(give) - give
        start = np.searchsorted(k, np.arange(len(needed)), side="left")
        offset = before[np.minimum(start, len(before) - 1)]
        taken[order] = np.clip(needed[k] - (before - offset[k]), 0.0, give)
    return taken.reshape(picks, n).sum(axis=0)


def steepness(V: FloatArray, F: IntArray, neighbour: IntArray) -> FloatArray:
    """How far out of the surface each vertex's move would lead it, (n,) float64 in [0, 1].

    Parameters
    ----------
    V : (n, 3) float64
        Vertex positions.
    F : (f, 3) int
        Triangles.
    neighbour : (n,) int
        The vertex each would move towards.

    Returns
    -------
    (n,) float64
        Largest |sine| between the move and the planes of the faces at the vertex.
    """
    normals = _normalized(face_normals(V, F))
    direction = _normalized(V[neighbour] - V)
    steep = np.zeros(len(V))
    for corner in F.T:
        np.maximum.at(steep, corner, np.abs(np.einsum("ij,ij->i", normals, direction[corner])))
    return steep


def _normalized(vectors: FloatArray) -> FloatArray:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0.0)
