"""Distances along edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.topology import edges
from meshmark_plugins.geodesics.base import BaseSolver


class DijkstraSolver(BaseSolver):
    """Lengths of shortest paths along edges.

    Parameters
    ----------
    V : (N, 3) array_like of float
        Vertex positions.
    F : (F, 3) array_like of int
        Triangles; any mesh will do.

    Raises
    ------
    InputError
        If the arrays are not those of a mesh.

    Notes
    -----
    Never shorter than the geodesic distance, and longer by up to some 10 % on an even mesh; a
    finer mesh does not bring it nearer. A metric: symmetric, and within the triangle inequality.

    Examples
    --------
    >>> import numpy as np
    >>> V = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 0]])
    >>> DijkstraSolver(V, [[0, 1, 2]]).distances([0]).tolist()
    [[0.0, 3.0, 5.0]]
    """

    def __init__(self, V: ArrayLike, F: ArrayLike) -> None:
        super().__init__(V, F)
        i, j = edges(self._F).T
        length = np.linalg.norm(self._V[i] - self._V[j], axis=1)
        self._graph = csr_matrix((length, (i, j)), shape=(len(self._V), len(self._V)))

    def _measure(self, sources: IntArray) -> FloatArray:
        return dijkstra(self._graph, directed=False, indices=sources)
