"""Heat-method distances by compiled loops, for many poses of one triangulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import load_loops, plain
from meshmark.mesh.factors import elimination_order

DELAUNAY_LOOPS, FACTOR_LOOPS = "meshmark.mesh.delaunay_loops", "meshmark.mesh.factor_loops"

# What is added to the Laplacian, in masses, so that it can be inverted.
POISSON_SHIFT = 1e-7


@dataclass(frozen=True, eq=False)
class HeatTopology:
    """What poses of one triangulation share: picklable, for worker processes.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    twins : (F, 3) int
        The side, 3 f + k, that each side of a triangle is one with; -1 on a border.
    place : (N,) int
        When each vertex is eliminated in the reference pose.
    parent, first : (N,) int
        Parent (-1 at a root) and first descendant of each place in the tree of elimination.
    """

    F: IntArray
    twins: IntArray
    place: IntArray
    parent: IntArray
    first: IntArray

    def distances(self, V: FloatArray, diffusion: float, in_sides: bool = False) -> HeatDistances:
        """Get ready to measure distances in a pose V (N, 3).

        Parameters
        ----------
        diffusion : float
            Diffusion length of the heat flow.
        in_sides : bool
            Whether it is given in mean sides of the Delaunay triangles.

        Raises
        ------
        RuntimeError
            If the pose is too degenerate.
        """
        return HeatDistances(self, plain(V), diffusion, in_sides)


class HeatDistances:
    """Heat-method distances [1]_ on the intrinsic Delaunay triangulation [2]_ of a pose.

    See `HeatTopology.distances`.

    Notes
    -----
    Weights of a Delaunay triangulation are not negative. Triangles without an area are given one,
    by making all sides a little longer [3]_.

    Both matrices are factored at once, as they have one pattern. The order of elimination is found
    once for a topology, by minimum degree. In another pose, the Delaunay triangulation has some
    other sides. Fill stays small while sides join descendants in the tree of elimination, so that
    one end of each side that does not is eliminated later.

    References
    ----------
    .. [1] K. Crane, C. Weischedel, M. Wardetzky, "Geodesics in heat", ACM Transactions on
       Graphics 32 (2013). doi:10.1145/2516971.2516977
    .. [2] M. Fisher, B. Springborn, P. Schröder, A. I. Bobenko, "An algorithm for the construction
       of intrinsic Delaunay triangulations with applications to digital geometry processing",
       Computing 81 (2007). doi:10.1007/s00607-007-0249-8
    .. [3] N. Sharp, K. Crane, "A Laplacian for nonmanifold triangle meshes", Computer Graphics
       Forum 39(5), 2020. doi:10.1111/cgf.14069
    """

    def __init__(
        self,
        topology: HeatTopology,
        V: FloatArray,
        diffusion: float,
        in_sides: bool,
    ) -> None:
        triangles, factor = load_loops(DELAUNAY_LOOPS), load_loops(FACTOR_LOOPS)
        if triangles is None or factor is None:
            raise RuntimeError("no numba")
        self.n_points = len(V)
        F, side = triangles.delaunay(topology.F, V, topology.twins)
        self._triangles = F, side
        self._place = factor.lifted_places(F, topology.place, topology.parent, topology.first)
        time = (diffusion * side.mean() if in_sides else diffusion) ** 2
        start, rows, values, diagonal, areas = triangles.laplacian(F, side, self._place)
        parent, self._filled = factor.elimination_tree(start, rows)
        diagonals = np.stack([areas + time * diagonal, diagonal + POISSON_SHIFT * areas])
        scales = np.array([time, 1.0])
        self._rows, self._L, self._D = factor.factors(
            start, rows, values, diagonals, scales, parent, self._filled
        )
        if not np.all(self._D > 0.0):
            raise RuntimeError("a matrix is not positive definite")
        self._descent, self._solved = triangles.descent, factor.solve

    def from_sources(self, heat: FloatArray) -> FloatArray:
        """Measure distances from where heat (S, N) is, up to a constant, (S, N)."""
        X = np.zeros(heat.T.shape)
        X[self._place] = heat.T
        self._solve(0, X)
        X = self._descent(*self._triangles, self._place, X)
        self._solve(1, X)
        return np.ascontiguousarray(X[self._place].T)

    def from_vertices(self, sources: IntArray) -> FloatArray:
        """Measure distances from vertices (S,), up to a constant, (S, N)."""
        heat = np.zeros((len(sources), self.n_points))
        heat[np.arange(len(sources)), sources] = 1.0
        return self.from_sources(heat)

    def _solve(self, which: int, X: FloatArray) -> None:
        self._solved(self._filled, self._rows, self._L[which], self._D[which], X)


def heat_topology(V: FloatArray, F: IntArray) -> HeatTopology | None:
    """Prepare measuring distances on poses of triangles F (F, 3), V (N, 3) being one of them.

    Returns
    -------
    HeatTopology or None
        None where numba is missing, or where more than two triangles have a side in common or some
        are turned the other way.
    """
    triangles, factor = load_loops(DELAUNAY_LOOPS), load_loops(FACTOR_LOOPS)
    twins = side_twins(F)
    if triangles is None or factor is None or twins is None:
        return None
    F, n = plain(F), len(V)
    delaunay, side = triangles.delaunay(F, plain(V), twins)
    place = np.argsort(elimination_order(delaunay, n))
    start, rows, *_ = triangles.laplacian(delaunay, side, place)
    parent, _ = factor.elimination_tree(start, rows)
    number = factor.post_order(parent)
    ordered = np.full(n, -1)
    ordered[number] = np.where(parent >= 0, number[parent], -1)
    return HeatTopology(F, twins, number[place], ordered, _first_descendants(ordered))


def side_twins(F: IntArray) -> IntArray | None:
    """Find the other triangle's side, 3 f + k, at each side of triangles, (F, 3); -1 on a border.

    Side k lies opposite to corner k. None where triangles do not make up a surface turned one way.
    """
    n = int(F.max(initial=0)) + 1
    tail, head = (np.roll(F, -shift, axis=1).ravel().astype(np.int64) for shift in (1, 2))
    own, other = tail * n + head, head * n + tail
    order = np.argsort(own, kind="stable")
    known = own[order]
    if np.any(known[1:] == known[:-1]):
        return None
    at = np.minimum(np.searchsorted(known, other), len(known) - 1)
    return np.where(known[at] == other, order[at], -1).reshape(-1, 3)


def _first_descendants(parent: IntArray) -> IntArray:
    """First descendant of each node of a forest numbered in post-order, (N,)."""
    size = np.ones(len(parent), dtype=np.int64)
    for node, above in enumerate(parent.tolist()):
        if above >= 0:
            size[above] += size[node]
    return np.arange(len(parent)) - size + 1
