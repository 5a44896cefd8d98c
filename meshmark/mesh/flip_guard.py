"""Keeps moved vertices near their places, and from turning faces over."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import lengths
from meshmark.mesh.kernels import compiled
from meshmark.mesh.topology import any_corner, edges

# Longest move of a vertex, in mean lengths of its own edges: a vertex that slid farther would
# drag its texture visibly along.
REACH = 1.0
HALVINGS = 6
# A face may tilt by at most this cosine (about 75 degrees) before its corners are held back:
# short of 90 degrees, so that later rounding to float32 cannot complete the turn.
LEAST_COSINE = 0.25


def restrain(V: FloatArray, moved: FloatArray, F: IntArray, reach: float = REACH) -> FloatArray:
    """Shorten moves until none is longer than `reach` edges, and no face of area turns over.

    Parameters
    ----------
    V, moved : (N, 3) float64
        Positions before and after.
    F : (F, 3) int
        Triangles.
    reach : float
        Longest move, in mean lengths of the vertex's edges; inf for any.

    Returns
    -------
    (N, 3) float64
        Positions between `V` and `moved`: a long move is cut; the moves of an offending face's
        corners are halved a few times, then dropped.
    """
    return V + allowed_shares(V, moved, F, reach)[:, None] * (moved - V)


def allowed_shares(
    V: FloatArray,
    moved: FloatArray,
    F: IntArray,
    reach: float = REACH,
    least_cosine: float = LEAST_COSINE,
) -> FloatArray:
    """Share of its move that `restrain` leaves each vertex, (N,) float64 in [0, 1].

    Parameters
    ----------
    least_cosine : float
        Of the angle by which a face may turn.
    """
    share = np.ones(len(V))
    if np.isfinite(reach):
        length = lengths(moved - V)
        limit = reach * mean_edge_lengths(V, F)
        share = np.divide(limit, length, out=share, where=length > limit)
    return untilted_shares(V, moved, F, share, least_cosine, HALVINGS)


@compiled
def untilted_shares(
    V: FloatArray,
    moved: FloatArray,
    F: IntArray,
    share: FloatArray,
    least_cosine: float,
    halvings: int,
) -> FloatArray:
    """Halve the shares (N,) of offending faces' corners so many times, then drop their moves."""
    share = share.copy()
    tilts = _Tilts(V, moved, F, least_cosine)
    suspects = np.arange(len(F))
    for _ in range(halvings):
        corners = tilts.offending_corners(share, suspects)
        share[corners] *= 0.5
        suspects = _faces_of(corners, F, len(V))
    # Dropping a corner's move may tilt a neighbour that leaned on it: each pass drops more
    # vertices, and with none moved nothing offends.
    while (corners := tilts.offending_corners(share, suspects)).size:
        share[corners] = 0.0
        suspects = _faces_of(corners, F, len(V))
    return share


class _Tilts:
    """Tells which faces tilt too far; asked of few faces once most are known not to."""

    def __init__(self, V: FloatArray, moved: FloatArray, F: IntArray, least_cosine: float) -> None:
        self._V, self._move, self._F = V, moved - V, F
        self._least_cosine = least_cosine
        self._moved = lengths(self._move) > 0.0
        self._before = face_normals(V, F)
        self._length = lengths(self._before)

    def offending_corners(self, share: FloatArray, faces: IntArray) -> IntArray:
        """List the corners of those of some faces that offend when moves are shortened so."""
        faces = faces[any_corner(self._moved & (share > 0.0), self._F[faces])]
        F = self._F[faces]
        after = normals_of(*(self._V[i] + share[i, None] * self._move[i] for i in F.T))
        dot = np.einsum("ij,ij->i", self._before[faces], after)
        size = self._length[faces] * lengths(after)
        return np.unique(F[dot < self._least_cosine * size])


def _faces_of(vertices: IntArray, F: IntArray, n_points: int) -> IntArray:
    """List the faces that have one of the vertices for a corner."""
    chosen = np.zeros(n_points, dtype=bool)
    chosen[vertices] = True
    return np.flatnonzero(any_corner(chosen, F))


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
