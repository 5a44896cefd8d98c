"""Keeps moved vertices near their places, and from turning faces over."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, vstack
from scipy.sparse.csgraph import dijkstra

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.geometry import lengths
from meshmark.mesh.topology import any_corner, edges, faces_about_vertices

# Longest move of a vertex, in mean lengths of its own edges: a vertex that slid farther would
# drag its texture visibly along.
REACH = 1.0
HALVINGS = 6
# A face may tilt by at most this cosine (about 75 degrees) before its corners are held back:
# short of 90 degrees, so that later rounding to float32 cannot complete the turn.
LEAST_COSINE = 0.25
# Stands for no difference between shares, where a graph knows no arc without length.
NO_SLOPE = 1e-12


def restrain(
    V: FloatArray,
    moved: FloatArray,
    F: IntArray,
    reach: float = REACH,
    ramp: float = 0.0,
) -> FloatArray:
    """Shorten moves until none is longer than `reach` edges, and no face of area turns over.

    Parameters
    ----------
    V, moved : (N, 3) float64
        Positions before and after.
    F : (F, 3) int
        Triangles.
    reach : float
        Longest move, in mean lengths of the vertex's edges; inf for any.
    ramp : float
        Way, in moves, over which they are shortened about a vertex that is held back; see
        `allowed_shares`.

    Returns
    -------
    (N, 3) float64
        Positions between `V` and `moved`: a long move is cut; the moves of an offending face's
        corners are halved a few times, then dropped.
    """
    return V + allowed_shares(V, moved, F, reach, ramp=ramp)[:, None] * (moved - V)


def allowed_shares(
    V: FloatArray,
    moved: FloatArray,
    F: IntArray,
    reach: float = REACH,
    least_cosine: float = LEAST_COSINE,
    ramp: float = 0.0,
) -> FloatArray:
    """Share of its move that `restrain` leaves each vertex, (N,) float64 in [0, 1].

    Parameters
    ----------
    least_cosine : float
        Of the angle by which a face may turn.
    ramp : float
        Along an edge, shares differ by no more than its length over so many moves; 0 for any
        difference. Where moves are longer than edges, one vertex that stayed would turn over the
        faces about it, its neighbours be held back for that, and so on over the whole surface.
    """
    share = np.ones(len(V))
    if np.isfinite(reach):
        length = lengths(moved - V)
        limit = reach * mean_edge_lengths(V, F)
        share = np.divide(limit, length, out=share, where=length > limit)
    return shares_without_tilt(V, moved, F, *faces_about_vertices(F), share, least_cosine, ramp)


@compiled
def shares_without_tilt(
    V: FloatArray,
    moved: FloatArray,
    F: IntArray,
    start: IntArray,
    about: IntArray,
    share: FloatArray,
    least_cosine: float,
    ramp: float,
) -> FloatArray:
    """Lower shares of moves (N,) until no face tilts too far; see `allowed_shares`.

    Parameters
    ----------
    start, about
        The `faces_about_vertices`, along which the loop goes from one to the next.
    """
    slopes: csr_matrix | None = None
    # Only faces about vertices whose share has changed can offend.
    changed = np.ones(len(V), dtype=bool)
    turn = 0
    while (offending := _tilted_corners(V, moved, F, share, changed, least_cosine)).any():
        # Dropping a corner's move may tilt a neighbour that leaned on it: each turn drops more
        # vertices, and with none moved nothing offends.
        before, share = share, np.where(offending, 0.5 * share if turn < HALVINGS else 0.0, share)
        if ramp > 0.0:
            slopes = _slopes(V, moved, F, ramp) if slopes is None else slopes
            share = _ramped(share, slopes)
        changed = share != before
        turn += 1
    return share


def _tilted_corners(
    V: FloatArray,
    moved: FloatArray,
    F: IntArray,
    share: FloatArray,
    changed: BoolArray,
    least_cosine: float,
) -> BoolArray:
    """Find the corners of faces that tilt too far if vertices go these shares (N,) of their ways.

    Returns
    -------
    (N,) bool
        Of those faces that have a corner in `changed` (N,), and one that moves.
    """
    move = moved - V
    faces = F[any_corner(changed, F)]
    faces = faces[any_corner(move.any(axis=1) & (share > 0.0), faces)]
    before = face_normals(V, faces)
    after = normals_of(*(V[i] + share[i, None] * move[i] for i in faces.T))
    dot = np.einsum("ij,ij->i", before, after)
    offending = np.zeros(len(V), dtype=bool)
    offending[faces[dot < least_cosine * (lengths(before) * lengths(after))]] = True
    return offending


def _slopes(V: FloatArray, moved: FloatArray, F: IntArray, ramp: float) -> csr_matrix:
    """By how much shares may differ along edges, (N, N) sparse; only where that is below 1."""
    E, move = edges(F), lengths(moved - V)
    length = lengths(V[E[:, 1]] - V[E[:, 0]])
    way = ramp * move[E].max(axis=1)
    steep = length < way
    E, slope = E[steep], length[steep] / way[steep]
    # An edge without length joins vertices all the same.
    slope = np.maximum(slope, NO_SLOPE)
    return csr_matrix((slope, (E[:, 0], E[:, 1])), shape=(len(V), len(V)))


def _ramped(share: FloatArray, slopes: csr_matrix) -> FloatArray:
    """Lower shares (N,) until none is larger than a neighbour's by more than it may be."""
    n, held = len(share), np.flatnonzero(share < 1.0)
    # From one more node to those held back, it is as far as their shares.
    start = csr_matrix(
        (np.maximum(share[held], NO_SLOPE), (np.zeros(len(held), dtype=np.int64), held)), (1, n)
    )
    graph = csr_matrix(vstack([slopes, start]))
    graph.resize(n + 1, n + 1)
    reached: FloatArray = dijkstra(graph, directed=False, indices=n, limit=1.0)
    return np.minimum(share, reached[:n])


def mean_edge_lengths(V: FloatArray, F: IntArray) -> FloatArray:
    """Mean length of the edges at each vertex, (N,) float64; 0 for a vertex without edges."""
    E = edges(F)
    length = lengths(V[E[:, 1]] - V[E[:, 0]])
    total = np.bincount(E[:, 0], length, len(V)) + np.bincount(E[:, 1], length, len(V))
    degree = np.bincount(E.reshape(-1), minlength=len(V))
    return np.divide(total, degree, out=np.zeros(len(V)), where=degree > 0)


def face_normals(V: FloatArray, F: IntArray) -> FloatArray:
    """Compute the normals of triangles, (F, 3) float64, as long as twice the area."""
    return normals_of(*(V[i] for i in F.T))


def normals_of(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Compute the normals of triangles with corners (F, 3) each, as long as twice the area."""
    return np.cross(b - a, c - a)
