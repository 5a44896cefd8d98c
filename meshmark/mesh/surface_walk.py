"""The closest point of a surface, by walking over it from a triangle nearby."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.closest_in_triangle import closest_in_triangle
from meshmark.mesh.topology import boundary_edges, faces_about_vertices

# How far from its query a walk may end, in roots of a triangle's area, should there be a closer
# place beyond a bend.
WALK_TOLERANCE = 0.07


def walk_to_closest(
    V: FloatArray, F: IntArray, Q: FloatArray, near: IntArray, tolerance: FloatArray
) -> IntArray:
    """Walk over a surface from triangles nearby to those that are closer than all around them.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    Q : (n, 3) float64
        Query points.
    near : (n,) int
        The triangle where each walk starts.
    tolerance : (n,) float64
        How far from its query each walk may end.

    Returns
    -------
    (n,) int
        Where it ended: no triangle that has the closest point on its sides, too, is closer. -1
        farther away, and where the surface ends, since another piece of it may go on there.
    """
    start, about = faces_about_vertices(F)
    border = np.zeros(len(start) - 1, dtype=bool)
    border[boundary_edges(F)] = True
    return walked(V, F, start, about, border, Q, near, tolerance)


@compiled
def walked(
    V: FloatArray,
    F: IntArray,
    start: IntArray,
    about: IntArray,
    border: BoolArray,
    Q: FloatArray,
    near: IntArray,
    tolerance: FloatArray,
) -> IntArray:
    """Do what `walk_to_closest` does.

    Parameters
    ----------
    start, about
        The `faces_about_vertices`.
    border : (N,) bool
        Vertices where the surface ends.
    """
    found, going = near.copy(), np.arange(len(Q))
    while going.size:
        face = found[going]
        corners = F[face]
        weights, square = _squares(V, corners, Q[going])
        # The closest point lies between these corners: on a side, if they are two.
        between = weights > 0.0
        first = corners[np.arange(len(face)), np.argmax(between, axis=1)]
        degree = np.diff(start)[first]
        row = np.repeat(np.arange(len(face)), degree)
        before = np.cumsum(degree) - degree
        other = about[np.arange(len(row)) + (start[first] - before)[row]]
        shared = (corners[row][:, :, None] == F[other][:, None, :]).any(axis=2)
        beside = (shared | ~between[row]).all(axis=1) & ~between[row].all(axis=1)
        row, other = row[beside], other[beside]
        there = _squares(V, F[other], Q[going[row]])[1]
        nearest = np.lexsort([there, row])
        nearest = nearest[np.diff(row[nearest], prepend=-1) > 0]
        nearest = nearest[there[nearest] < square[row[nearest]]]
        rests = np.ones(len(face), dtype=bool)
        rests[row[nearest]] = False
        ends = rests & (border[corners] | ~between).all(axis=1) & ~between.all(axis=1)
        ends |= rests & (square > tolerance[going] ** 2)
        found[going[ends]] = -1
        found[going[row[nearest]]] = other[nearest]
        going = going[row[nearest]]
    return found


def _squares(V: FloatArray, corners: IntArray, Q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Weights (n, 3) of the corners of a triangle each that make its closest point; its square."""
    places = V[corners]
    weights = closest_in_triangle(Q, *places.swapaxes(0, 1))
    return weights, ((np.einsum("ij,ijx->ix", weights, places) - Q) ** 2).sum(axis=1)
