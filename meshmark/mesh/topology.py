"""Connectivity alone: triangles, edges, one-rings, components; and welding."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.remembered import read_only, remembered

if TYPE_CHECKING:
    # scipy is imported where it is needed: who only reads a mesh has read it in less time.
    from scipy.sparse import csr_matrix


def triangulate(counts: IntArray, indices: IntArray) -> IntArray:
    """Split polygons into fans of triangles about their first corner.

    Parameters
    ----------
    counts : (P,) int
        Corners of each polygon, each at least 3.
    indices : (sum(counts),) int
        Point index of each corner.

    Returns
    -------
    (F, 3) int
        Triangles in polygon order, same orientation.
    """
    if np.all(counts == 3):
        return indices.reshape(-1, 3)
    start = np.concatenate([[0], np.cumsum(counts)[:-1]])
    n = counts - 2
    polygon = np.repeat(np.arange(len(counts)), n)
    step = np.arange(len(polygon)) - np.repeat(np.cumsum(n) - n, n)
    first = start[polygon]
    return np.stack([indices[first], indices[first + step + 1], indices[first + step + 2]], axis=1)


def edges(F: IntArray) -> IntArray:
    """List each undirected edge once, (E, 2) int, lower index first, sorted."""
    return counted_edges(F)[0]


def polygon_edges(counts: IntArray, indices: IntArray) -> tuple[IntArray, IntArray]:
    """List the edges of polygons themselves, without diagonals.

    Parameters
    ----------
    counts : (P,) int
        Corners of each polygon.
    indices : (sum(counts),) int
        Point index of each corner.

    Returns
    -------
    edges : (E, 2) int
        Each undirected edge once, lower index first.
    uses : (E,) int
        Number of polygons along each edge: 1 on a border.
    """
    ends = np.cumsum(counts)
    following = np.arange(1, len(indices) + 1)
    following[ends - 1] = ends - counts
    return _counted(indices, indices[following])


def face_adjacency(F: IntArray) -> tuple[IntArray, IntArray]:
    """List pairs of faces that share an edge.

    Returns
    -------
    pairs : (A, 2) int
        Face indices, lower first. An edge with k faces gives k - 1 pairs (a chain).
    shared : (A, 2) int
        The vertices of the shared edge, lower first.
    """
    # The sides of each face together, so that a stable sort leaves faces in order.
    a, b = F.astype(np.int64).ravel(), np.roll(F, -1, axis=1).astype(np.int64).ravel()
    low, high = np.minimum(a, b), np.maximum(a, b)
    side = np.flatnonzero(low != high)
    n = int(high.max(initial=0)) + 1
    code = low[side] * n + high[side]
    order = np.argsort(code, kind="stable")
    code, face = code[order], side[order] // 3
    same = (code[1:] == code[:-1]) & (face[1:] != face[:-1])
    pairs = np.stack([face[:-1][same], face[1:][same]], axis=1)
    return pairs, np.stack(np.divmod(code[1:][same], n), axis=1)


def boundary_edges(F: IntArray) -> IntArray:
    """List the edges that belong to exactly one face, (B, 2) int."""
    unique, count = counted_edges(F)
    return unique[count == 1]


@remembered
def counted_edges(F: IntArray) -> tuple[IntArray, IntArray]:
    """List each undirected edge once, with the number of triangle sides that are that edge.

    Returns
    -------
    edges : (E, 2) int
        As `edges` lists them.
    uses : (E,) int
    """
    a, b = np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]).astype(np.int64).T
    listed, uses = _counted(a, b)
    return read_only(listed), read_only(uses)


def _counted(a: IntArray, b: IntArray) -> tuple[IntArray, IntArray]:
    """List each pair (a_i, b_i), whichever comes first, once, and how often it is there."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    proper = low != high
    # One number an edge: sorting numbers is several times quicker than sorting rows.
    n = int(high.max(initial=0)) + 1
    code, count = np.unique(low[proper] * n + high[proper], return_counts=True)
    return np.stack([code // n, code % n], axis=1), count


def any_corner(vertices: NDArray[np.bool_], F: IntArray) -> NDArray[np.bool_]:
    """Which triangles have at least one of some vertices (N,) bool for a corner, (F,) bool."""
    a, b, c = F.T
    return vertices[a] | vertices[b] | vertices[c]


def vertex_adjacency(F: IntArray, n_points: int) -> csr_matrix:
    """Build the symmetric one-ring matrix, (N, N) sparse, 1.0 where two vertices share an edge."""
    from scipy.sparse import csr_matrix

    E = edges(F)
    i = np.concatenate([E[:, 0], E[:, 1]])
    j = np.concatenate([E[:, 1], E[:, 0]])
    return csr_matrix((np.ones(len(i)), (i, j)), shape=(n_points, n_points))


@remembered
def faces_about_vertices(F: IntArray) -> tuple[IntArray, IntArray]:
    """List the triangles about each vertex, one after the other, in one list.

    Returns
    -------
    start : (N + 1,) int
        Where the triangles of each vertex begin, up to the last vertex that has one.
    about : (3 F,) int
        Triangles; one that has a vertex twice is listed twice.
    """
    corners = F.ravel()
    start = np.concatenate([[0], np.cumsum(np.bincount(corners))])
    about = np.argsort(corners, kind="stable") // 3
    return read_only(start), read_only(about)


def graph_components(pairs: IntArray, n: int) -> IntArray:
    """Label the connected components of a graph, (n,) int, in the order of their first nodes.

    Parameters
    ----------
    pairs : (A, 2) int
        Nodes joined by an arc.
    n : int
        Number of nodes; one without arcs is a component of its own.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def vertex_components(F: IntArray, n_points: int) -> IntArray:
    """Label the connected components of the vertices, (N,) int; an unused vertex is its own."""
    return graph_components(edges(F), n_points)


def face_components(F: IntArray, labels: IntArray | None = None) -> IntArray:
    """Label the edge-connected components of faces, (F,) int.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    labels : (F,) int, optional
        If given, two faces are connected only where they also share a label.
    """
    if labels is None:
        return _connected_faces(F)
    pairs, _ = face_adjacency(F)
    return graph_components(pairs[labels[pairs[:, 0]] == labels[pairs[:, 1]]], len(F))


@remembered
def _connected_faces(F: IntArray) -> IntArray:
    return read_only(graph_components(face_adjacency(F)[0], len(F)))


def weld(V: FloatArray, F: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Merge exactly coincident vertices, for analysis of unindexed meshes.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.

    Returns
    -------
    V : (M, 3) float64
        Kept positions, ordered by first appearance.
    F : (F, 3) int
        Triangles over them; degenerate ones are kept, in place.
    new : (N,) int
        New index of each old vertex.
    """
    order = np.lexsort(V.T)
    x, y, z = V[order].T
    # Of coincident vertices, sorting leaves the first one first.
    starts = np.ones(len(V), dtype=bool)
    starts[1:] = (x[1:] != x[:-1]) | (y[1:] != y[:-1]) | (z[1:] != z[:-1])
    kept = np.zeros(len(V), dtype=bool)
    kept[order[starts]] = True
    rank = np.cumsum(kept) - 1
    new = np.empty(len(V), dtype=np.int64)
    new[order] = rank[order[starts]][np.cumsum(starts) - 1]
    return V[kept], new[F], new


@dataclass(frozen=True, eq=False)
class Topology:
    """Polygons over `n_points` points, and their triangles for analysis.

    Parameters
    ----------
    counts : (P,) int
        Corners of each polygon.
    indices : (sum(counts),) int
        Point index of each corner, polygon after polygon.
    n_points : int
        Number of points the indices refer to.
    left_out : str
        What is wrong with polygons that were left out; see `fit`.

    Raises
    ------
    InputError
        If an index is out of range, a polygon has fewer than three corners, or counts and
        indices do not agree.
    """

    counts: IntArray
    indices: IntArray
    n_points: int
    left_out: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "counts", np.ascontiguousarray(self.counts, dtype=np.int64))
        object.__setattr__(self, "indices", np.ascontiguousarray(self.indices, dtype=np.int64))
        if self.counts.size == 0:
            raise InputError("the mesh has no faces")
        if self.counts.min() < 3:
            raise InputError("the mesh has a face with fewer than three corners")
        # One by one first: the sum of numbers out of a file may overflow.
        largest = int(self.counts.max())
        corners = largest if largest > self.indices.size else int(self.counts.sum())
        if corners != self.indices.size:
            raise InputError(
                f"face counts ask for {corners} corners, but {self.indices.size} indices are given"
            )
        low, high = int(self.indices.min()), int(self.indices.max())
        if low < 0 or high >= self.n_points:
            raise InputError(
                f"face index {low if low < 0 else high} is out of range for {self.n_points} points"
            )

    @classmethod
    def fit(cls, counts: IntArray, indices: IntArray, n_points: int) -> Topology:
        """Build a topology of those polygons that are any, if there are some.

        One bad index in a copy must not keep the rest of it from being looked at. What was left
        out is told in `left_out`; `meshmark.mesh.checks.check` refuses it.
        """
        try:
            return cls(counts, indices, n_points)
        except InputError as error:
            if len(counts) == 0 or counts.min() < 0 or counts.max() > len(indices):
                raise
            if counts.sum() != len(indices):
                raise
            polygon = np.repeat(np.arange(len(counts)), counts)
            kept = counts >= 3
            kept[polygon[(indices < 0) | (indices >= n_points)]] = False
            if not kept.any():
                raise
            told = f"{np.sum(~kept)} of {len(kept)} faces cannot be used: {error.message}"
            return cls(counts[kept], indices[kept[polygon]], n_points, told)

    @classmethod
    def from_triangles(cls, faces: IntArray, n_points: int) -> Topology:
        """Build a topology of triangles, `faces` (F, 3) int."""
        return cls(np.full(len(faces), 3, dtype=np.int64), np.asarray(faces).reshape(-1), n_points)

    @cached_property
    def triangles(self) -> IntArray:
        """Polygons as a fan of triangles, (F, 3) int, in polygon order; they cannot be written to.

        What was found out about them is `remembered`.
        """
        return read_only(triangulate(self.counts, self.indices))

    def digest(self) -> bytes:
        """Return what is equal for topologies that are the same."""
        found = hashlib.blake2b(self.counts.tobytes(), digest_size=16)
        found.update(self.indices.tobytes())
        found.update(f"{self.n_points} {self.left_out}".encode())
        return found.digest()

    def same_as(self, other: Topology) -> bool:
        """Tell whether both describe the same polygons over the same number of points."""
        return self is other or (
            self.n_points == other.n_points
            and np.array_equal(self.counts, other.counts)
            and np.array_equal(self.indices, other.indices)
        )
