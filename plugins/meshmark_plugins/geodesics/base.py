"""What all solvers do: look at the mesh they are built on, and at the sources they are asked of."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import UsageError
from meshmark.mesh.checks import mesh_arrays


class BaseSolver(ABC):
    """Geodesic distances on one mesh.

    Parameters
    ----------
    V : (N, 3) array_like of float
        Vertex positions.
    F : (F, 3) array_like of int
        Triangles.

    Raises
    ------
    InputError
        If the arrays are not those of a mesh.
    """

    def __init__(self, V: ArrayLike, F: ArrayLike) -> None:
        self._V, self._F = mesh_arrays(V, F)

    def distances(self, sources: ArrayLike) -> FloatArray:
        """Measure the distance along the surface from each source to every vertex.

        Parameters
        ----------
        sources : (S,) array_like of int
            Vertex indices.

        Returns
        -------
        (S, N) float64
            Distances in the unit of `V`; 0 at the source, inf in other components.

        Raises
        ------
        UsageError
            If a source is out of range.
        CapacityError
            If a source's component is too degenerate to solve on, such as a single point.
        """
        indices = _indices(sources, len(self._V))
        return self._measure(indices) if len(indices) else np.zeros((0, len(self._V)))

    @abstractmethod
    def _measure(self, sources: IntArray) -> FloatArray:
        """Measure from one source or more, all in range."""


def _indices(sources: ArrayLike, n_points: int) -> IntArray:
    indices = np.asarray(sources)
    if indices.size == 0:
        return np.zeros(0, dtype=np.int64)
    if indices.ndim != 1 or indices.dtype.kind not in "iu":
        raise UsageError(
            f"sources must be a list of vertex indices, not {indices.dtype} {indices.shape}"
        )
    low, high = int(indices.min()), int(indices.max())
    if low < 0 or high >= n_points:
        raise UsageError(
            f"source vertex {low if low < 0 else high} is out of range for {n_points} points"
        )
    return indices.astype(np.int64)
