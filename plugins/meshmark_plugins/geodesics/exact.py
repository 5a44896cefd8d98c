"""Exact distances on the polyhedron."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.topology import graph_components
from meshmark_plugins.geodesics.components import ComponentwiseSolver, OneSource


class ExactSolver(ComponentwiseSolver):
    """Lengths of the shortest paths on the polyhedral surface, by window propagation [1]_.

    Parameters
    ----------
    V : (N, 3) array_like of float
        Vertex positions.
    F : (F, 3) array_like of int
        Triangles of a manifold, open or closed, in any number of components.

    Raises
    ------
    InputError
        If the arrays are not those of a mesh, or an edge or a vertex is not manifold.

    Notes
    -----
    For reference: a quarter of a second a source at eight thousand points, where the heat
    method takes 3 ms, and no better for a mark: at a bent joint the shortest path jumps.

    References
    ----------
    .. [1] J. Mitchell, D. Mount, C. Papadimitriou, "The discrete geodesic problem", SIAM Journal
       on Computing 16 (1987). doi:10.1137/0216045

    Examples
    --------
    >>> import numpy as np
    >>> V = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> D = ExactSolver(V, [[0, 1, 3], [1, 2, 3]]).distances([0])
    >>> bool(np.isclose(D[0, 2], np.sqrt(2)))
    True
    """

    def __init__(self, V: ArrayLike, F: ArrayLike) -> None:
        super().__init__(V, F)
        # The library underneath does not survive anything else.
        _require_manifold(self._F)

    def _build(self, V: FloatArray, F: IntArray) -> OneSource:
        from pygeodesic.geodesic import PyGeodesicAlgorithmExact

        algorithm = PyGeodesicAlgorithmExact(V, F.astype(np.int32))

        def solve(source: int) -> FloatArray:
            distance, _ = algorithm.geodesicDistances([source], None)
            return np.asarray(distance, dtype=np.float64)

        return solve


def _require_manifold(F: IntArray) -> None:
    """Refuse edges with more than two faces and vertices with more than one fan of faces."""
    half = np.sort(np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]), axis=1)
    edge, inverse, count = np.unique(half, axis=0, return_inverse=True, return_counts=True)
    crowded = np.flatnonzero(count > 2)
    if len(crowded):
        a, b = edge[crowded[0]]
        raise InputError(
            f"the exact solver wants a manifold mesh, but the edge of vertices {a} and {b} has "
            f"{count[crowded[0]]} faces; use heat"
        )
    # Corners of a vertex join across the edges they share; a fan is a component of corners.
    corner = np.arange(F.size).reshape(F.shape)
    ends = np.concatenate([corner[:, [0, 1]], corner[:, [1, 2]], corner[:, [2, 0]]])
    flat = F.reshape(-1)
    swapped = flat[ends[:, 0]] > flat[ends[:, 1]]
    ends[swapped] = ends[swapped][:, ::-1]
    order = np.argsort(inverse.reshape(-1), kind="stable")
    paired = inverse.reshape(-1)[order]
    twin = np.flatnonzero(paired[1:] == paired[:-1])
    one, two = ends[order[twin]].reshape(-1), ends[order[twin + 1]].reshape(-1)
    fan = graph_components(np.stack([one, two], axis=1), F.size)
    pinched = np.unique(np.stack([flat, fan], axis=1), axis=0)[:, 0]
    twice = pinched[1:][pinched[1:] == pinched[:-1]]
    if len(twice):
        raise InputError(
            "the exact solver wants a manifold mesh, but two fans of faces meet at vertex "
            f"{twice[0]}; use heat"
        )
