"""A coarse mesh that stands for a fine one in all of its poses, where only large features count."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags_array
from scipy.sparse.csgraph import dijkstra

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.factors import SymmetricFactor, elimination_order
from meshmark.mesh.geometry import lengths, vertex_areas, vertex_normals
from meshmark.mesh.prolongation import prolongation
from meshmark.mesh.remembered import read_only
from meshmark.mesh.topology import counted_edges, face_components

# Rounds in which samples move to the middle of what is nearest to them.
LLOYD_ROUNDS = 2
# Steps in which the size of the grid's cells is found, and how near to the wanted number of samples
# is near enough.
BISECTION_STEPS, ENOUGH = 16, 0.02
# Rounds in which samples that no triangle uses are given up.
PRUNING_ROUNDS = 4
# A vertex farther from its place on the proxy, in mean distances between samples, belongs to
# something that is too thin for the proxy.
MAX_GAP = 1.0
# Smallest weight of a vertex, as a share of the mean one.
MIN_WEIGHT_SHARE = 1e-3


@dataclass(frozen=True, eq=False)
class Proxy:
    """A coarse mesh between sampled vertices of a fine one, and how the fine one hangs on it.

    Parameters
    ----------
    samples : (n,) int
        Vertices of the fine mesh.
    faces : (f, 3) int
        Triangles of the coarse mesh, indices into `samples`.
    prolongation : (N, n) sparse float64
        Barycentric coordinates of each vertex of the fine mesh in a triangle of the coarse one:
        values at the coarse vertices become values at the fine ones.
    weights : (N,) float64
        How much each vertex of the fine mesh counts where the coarse one is fitted.
    """

    samples: IntArray
    faces: IntArray
    prolongation: csr_matrix
    weights: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", read_only(self.faces))

    def fit(self, V: FloatArray) -> FloatArray:
        """Fit the coarse mesh to a pose V (N, 3) of the fine one, (n, 3), by least squares.

        The samples' own positions would not do: on them, noise stays as strong as it is, and
        what is round loses area.
        """
        positions: FloatArray = self._factor.solve(self._restriction @ V)
        return positions

    def prolong(self, values: FloatArray) -> FloatArray:
        """Interpolate rows of values at the coarse vertices, (S, n), at the fine ones, (S, N)."""
        # Row by row: products with several columns at once take longer.
        return np.array([self.prolongation @ row for row in values])

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the factor, which cannot be."""
        return Proxy, (self.samples, self.faces, self.prolongation, self.weights)

    @cached_property
    def order(self) -> IntArray:
        """The order of its vertices in which factors stay sparse, (n,)."""
        return elimination_order(self.faces, len(self.samples))

    @cached_property
    def _restriction(self) -> csr_matrix:
        return csr_matrix(self.prolongation.T @ diags_array(self.weights))

    @cached_property
    def _factor(self) -> SymmetricFactor:
        return SymmetricFactor(self._restriction @ self.prolongation, self.order)


def build_proxy(V: FloatArray, F: IntArray, n_samples: int) -> Proxy | None:
    """Build a proxy of one connected surface, or find that none would stand for it.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions in some pose; no vertex is unused.
    F : (F, 3) int
        Triangles that hang together by their edges.
    n_samples : int
        About how many vertices the proxy is to have, fewer than N.

    Returns
    -------
    Proxy or None
        None where the surface is in places too thin for so few samples, or has no area.

    Notes
    -----
    Samples are spread by a grid over place and normal, and moved to the middle of the vertices
    that are nearest to each along edges. Three samples become a triangle where a triangle of the
    mesh has its corners nearest to those three: the dual of a Voronoi diagram on the mesh [1]_.

    References
    ----------
    .. [1] G. Peyré, L. Cohen, "Geodesic remeshing using front propagation", International Journal
       of Computer Vision 69 (2006). doi:10.1007/s11263-006-6859-3
    """
    areas = vertex_areas(V, F)
    if not 0.0 < areas.sum() < np.inf:
        return None
    weights = np.maximum(areas, MIN_WEIGHT_SHARE * areas.mean())
    E, uses = counted_edges(F)
    border = np.zeros(len(V), dtype=bool)
    border[E[uses == 1]] = True
    graph = _edge_graph(V, E)
    samples = _spread(V, F, weights, border, n_samples)
    for _ in range(LLOYD_ROUNDS):
        samples = _middles(V, weights, border, _nearest(graph, samples))
    for _ in range(PRUNING_ROUNDS):
        nearest = _nearest(graph, samples)
        faces = _dual_triangles(nearest, F)
        used = np.unique(faces)
        if len(used) == len(samples):
            break
        samples = samples[used]
    else:
        return None
    if not len(faces) or face_components(faces).any():
        return None
    P = prolongation(V, samples, faces, nearest)
    gaps = lengths(P @ V[samples] - V)
    if gaps.max() > MAX_GAP * np.sqrt(areas.sum() / len(samples)):
        return None
    return Proxy(samples, faces, P, weights)


def _edge_graph(V: FloatArray, E: IntArray) -> csr_matrix:
    """Lengths of edges (E, 2) between the vertices they join, (N, N) sparse."""
    i, j = np.concatenate([E, E[:, ::-1]]).T
    length = lengths(V[i] - V[j])
    # An edge without length joins vertices all the same.
    length = np.maximum(length, 1e-12 * length.max())
    return csr_matrix((length, (i, j)), shape=(len(V), len(V)))


def _spread(
    V: FloatArray, F: IntArray, weights: FloatArray, border: NDArray[np.bool_], n_samples: int
) -> IntArray:
    """Spread about n samples over a surface: one in each cell of a grid over place and normal."""
    facing = np.round(vertex_normals(V, F)).astype(np.int64) + 1
    kind = np.column_stack([facing, border]) @ [1, 3, 9, 27]
    offset, extent = V - V.min(axis=0), float(np.ptp(V, axis=0).max())

    def cells(size: float) -> IntArray:
        along = int(extent / size) + 1
        x, y, z = (offset / size).astype(np.int64).T
        return ((x * along + y) * along + z) * 54 + kind

    # Cells of a grid are at least as wide as this share of the distance between samples.
    size = float(np.sqrt(weights.sum() / n_samples))
    low, high = size / 16.0, size * 16.0
    for _ in range(BISECTION_STEPS):
        size = float(np.sqrt(low * high))
        count = len(np.unique(cells(size)))
        if abs(count - n_samples) <= ENOUGH * n_samples:
            break
        low, high = (size, high) if count > n_samples else (low, size)
    _, cell = np.unique(cells(size), return_inverse=True)
    return _middles(V, weights, border, cell)


def _middles(
    V: FloatArray, weights: FloatArray, border: NDArray[np.bool_], part: IntArray
) -> IntArray:
    """Find the vertex nearest to the centre of gravity of each part, (n,) int.

    Of a part on the border, it is one on the border, so that the border stays where it is.
    """
    n = int(part.max()) + 1
    on_border = np.bincount(part, border, n) > 0
    able = np.flatnonzero(border | ~on_border[part])
    part, mass, P = part[able], weights[able], V[able]
    total = np.bincount(part, mass, n)
    centre = np.stack([np.bincount(part, mass * x, n) / total for x in P.T], axis=1)
    away = lengths(P - centre[part])
    least = np.full(n, np.inf)
    np.minimum.at(least, part, away)
    # Backwards, so that the first of several stays.
    nearest = np.flatnonzero(away == least[part])[::-1]
    middles = np.empty(n, dtype=np.int64)
    middles[part[nearest]] = able[nearest]
    return middles


def _nearest(graph: csr_matrix, samples: IntArray) -> IntArray:
    """Find the sample that is nearest to each vertex along edges, (N,) int."""
    _, _, source = dijkstra(graph, indices=samples, min_only=True, return_predecessors=True)
    number = np.zeros(graph.shape[0], dtype=np.int64)
    number[samples] = np.arange(len(samples))
    return number[source]


def _dual_triangles(nearest: IntArray, F: IntArray) -> IntArray:
    """List the triangles between samples whose regions meet in a triangle of the mesh, (f, 3).

    Where regions meet once from each side of the surface, as they do where it is a thin tube,
    the two triangles cancel, and neighbours close the gap: the border stays what it was.
    """
    a, b, c = nearest[F].T
    kept = (a != b) & (b != c) & (c != a)
    corners = np.stack([a, b, c], axis=1)[kept]
    turn = (np.argmin(corners, axis=1)[:, None] + np.arange(3)) % 3
    corners = np.take_along_axis(corners, turn, axis=1)
    side = np.where(corners[:, 1] < corners[:, 2], 1, -1)
    n = int(nearest.max()) + 1
    code = (np.sort(corners, axis=1) * [n * n, n, 1]).sum(axis=1)
    code, inverse = np.unique(code, return_inverse=True)
    balance = np.bincount(inverse, side, len(code))
    low, middle, high = code // (n * n), code // n % n, code % n
    up = balance > 0
    triangles = np.stack([low, np.where(up, middle, high), np.where(up, high, middle)], axis=1)
    return triangles[balance != 0]
