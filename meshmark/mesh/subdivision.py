"""Subdivision of triangles as linear maps: new points are weighted sums of old ones.

An edge with other than two faces, or between faces of opposite orientation, is a border, where
every rule works along the edge only.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_matrix, diags_array, eye_array, vstack

from meshmark.arrays import BoolArray, IntArray

Rule = Callable[[IntArray, int], tuple[csr_matrix, IntArray]]


def midpoint(F: IntArray, n_points: int) -> tuple[csr_matrix, IntArray]:
    """Put a point in the middle of every edge: four triangles where there was one.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    n_points : int
        Number of points N.

    Returns
    -------
    weights : (N + E, N) sparse
        Old points first, then one for each edge.
    F : (4 F, 3) int
        Triangles over the new points.
    """
    E, edge_of, _ = _edges(F)
    halves = _rows(E, 0.5, n_points)
    return csr_matrix(vstack([eye_array(n_points), halves])), _split(F, edge_of + n_points)


def loop(F: IntArray, n_points: int) -> tuple[csr_matrix, IntArray]:
    """Apply Loop's rule; see `midpoint` for the shapes.

    An inner edge's point is 3/8 of its ends and 1/8 of the corners across; an inner vertex with
    n neighbours keeps 1 - n b of itself, b = (5/8 - (3/8 + cos(2 pi / n) / 4)^2) / n. Borders
    are cubic splines.
    """
    E, edge_of, inner = _edges(F)
    ends = _rows(E, 1.0, n_points)
    # Each face gives the edge opposite to a corner that corner.
    across = csr_matrix(
        (np.ones(F.size), (edge_of.ravel(), F[:, [2, 0, 1]].ravel())), shape=(len(E), n_points)
    )
    edge_points = (
        diags_array(np.where(inner, 0.375, 0.5)) @ ends
        + diags_array(np.where(inner, 0.125, 0.0)) @ across
    )
    A, degree, fixed = _neighbours(E, inner, n_points)
    n = np.maximum(degree, 1)
    beta = (0.625 - (0.375 + 0.25 * np.cos(2 * np.pi / n)) ** 2) / n
    share = np.where(fixed | (degree == 0), 0.0, beta)
    vertex_points = diags_array(1.0 - share * degree) @ eye_array(n_points) + diags_array(share) @ A
    vertex_points = vertex_points + _border_smoothing(E[~inner], n_points)
    return csr_matrix(vstack([vertex_points, edge_points])), _split(F, edge_of + n_points)


def sqrt3(F: IntArray, n_points: int) -> tuple[csr_matrix, IntArray]:
    """Apply Kobbelt's rule: a point in every face, inner edges flipped, inner vertices relaxed.

    A vertex with n neighbours moves to (1 - a) of itself and a of their mean,
    a = (4 - 2 cos(2 pi / n)) / 9. Borders stay.

    Returns
    -------
    weights : (N + F, N) sparse
        Old points first, then one for each face.
    F : (3 F, 3) int
        Triangles over the new points.
    """
    E, edge_of, inner = _edges(F)
    centres = _rows(F, 1 / 3, n_points)
    A, degree, fixed = _neighbours(E, inner, n_points)
    n = np.maximum(degree, 1)
    alpha = np.where(fixed | (degree == 0), 0.0, (4.0 - 2.0 * np.cos(2 * np.pi / n)) / 9.0)
    vertex_points = diags_array(1.0 - alpha) + diags_array(alpha / n) @ A
    return csr_matrix(vstack([vertex_points, centres])), _flip(F, edge_of, inner, n_points)


RULES: dict[str, Rule] = {"midpoint": midpoint, "loop": loop, "sqrt3": sqrt3}


def _half_edges(F: IntArray) -> IntArray:
    return np.stack([F, F[:, [1, 2, 0]]], axis=2).reshape(-1, 2)


def _edges(F: IntArray) -> tuple[IntArray, IntArray, BoolArray]:
    """List edges (E, 2), the edge of each face's sides ab, bc, ca (F, 3), and which are inner."""
    half = _half_edges(F)
    E, edge_of, uses = np.unique(
        np.sort(half, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    edge_of = edge_of.reshape(-1)
    forward = np.bincount(edge_of[half[:, 0] < half[:, 1]], minlength=len(E))
    return E, edge_of.reshape(-1, 3), (uses == 2) & (forward == 1)


def _rows(columns: IntArray, weight: float, n_points: int) -> csr_matrix:
    """Build a matrix whose row i has the weight in the given columns."""
    n, k = columns.shape
    place = (np.repeat(np.arange(n), k), columns.ravel())
    return csr_matrix((np.full(n * k, weight), place), shape=(n, n_points))


def _neighbours(
    E: IntArray, inner: BoolArray, n_points: int
) -> tuple[csr_matrix, IntArray, BoolArray]:
    """Build the one-ring matrix, its row sums, and which vertices lie on a border."""
    i, j = np.concatenate([E, E[:, ::-1]]).T
    A = csr_matrix((np.ones(len(i)), (i, j)), shape=(n_points, n_points))
    fixed = np.zeros(n_points, dtype=bool)
    fixed[E[~inner].ravel()] = True
    return A, np.bincount(i, minlength=n_points), fixed


def _border_smoothing(border: IntArray, n_points: int) -> csr_matrix:
    """Build what moves a border vertex by 1/8 towards each of its two border neighbours."""
    i, j = np.concatenate([border, border[:, ::-1]]).T
    A = csr_matrix((np.ones(len(i)), (i, j)), shape=(n_points, n_points))
    # Where borders meet or end there is no curve to smooth.
    curve = np.where(np.bincount(i, minlength=n_points) == 2, 0.125, 0.0)
    return csr_matrix(diags_array(curve) @ A - diags_array(2.0 * curve))


def _split(F: IntArray, side: IntArray) -> IntArray:
    """Cut triangles in four; `side` (F, 3) are the points on the sides ab, bc and ca."""
    a, b, c = F.T
    ab, bc, ca = side.T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(quarter, axis=1) for quarter in quarters], axis=1).reshape(-1, 3)


def _flip(F: IntArray, edge_of: IntArray, inner: BoolArray, n_points: int) -> IntArray:
    """Connect face points across inner edges, and to the ends of borders."""
    half, edge = _half_edges(F), edge_of.ravel()
    centre = np.repeat(np.arange(len(F)), 3) + n_points
    order = np.argsort(edge, kind="stable")
    order = order[inner[edge[order]]]
    # Sorted by edge, the two half-edges of an inner edge lie side by side.
    one, two = order[0::2], order[1::2]
    across = np.full(len(half), -1)
    across[one], across[two] = centre[two], centre[one]
    # A half-edge a -> b makes (a, other face's point, own point); the twin makes b's.
    third = np.where(across >= 0, across, half[:, 1])
    return np.stack([half[:, 0], third, centre], axis=1)
