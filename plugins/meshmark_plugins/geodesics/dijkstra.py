"""Distances along edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from meshmark.arrays import FloatArray
from meshmark.mesh.checks import mesh_arrays
from meshmark.mesh.topology import edges
from meshmark_plugins.geodesics.sources import source_indices


class DijkstraSolver:
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
        points, faces = mesh_arrays(V, F)
        i, j = edges(faces).T
        length = np.linalg.norm(points[i] - points[j], axis=1)
        self._graph = csr_matrix((length, (i, j)), shape=(len(points), len(points)))

    def distances(self, sources: ArrayLike) -> FloatArray:
        """Measure the shortest path along edges from each source to every vertex.

        Parameters
        ----------
        sources : (S,) array_like of int
            Vertex indices.

        Returns
        -------
        (S, N) float64
            Lengths in the unit of `V`; inf where no path leads.

        Raises
        ------
        UsageError
            If a source is out of range.
        """
        n = self._graph.shape[0]
        indices = source_indices(sources, n)
        if len(indices) == 0:
            return np.zeros((0, n))
        return dijkstra(self._graph, directed=False, indices=indices)
