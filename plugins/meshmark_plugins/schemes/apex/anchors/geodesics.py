"""Geodesic distances that do not depend on how finely the surface is meshed."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.geometry import face_areas, lengths
from meshmark.mesh.topology import edges
from meshmark_plugins.schemes.apex.anchors.boundary_extension import extend_boundary

# Diffusion length of the heat flow in root areas. The usual choice, a mean edge, ties distances
# to the sampling, which is what attacks change.
DIFFUSION_LENGTH = 0.2
# Width in root areas of the strip by which borders are extended first. Heat does not flow over a
# border, which bends distances near a cut; with more surface to flow into, they stay as they were.
EXTENSION_WIDTH = 0.1
# Shorter borders, in root areas, are not extended: a hole that is small beside the diffusion length
# bends distances little.
MIN_BORDER_LENGTH = 0.3


class GeodesicDistances:
    """Heat-method distances [1]_ with a time of flow fixed by the surface, not by its mesh.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions of one connected surface; no vertex is unused.
    F : (F, 3) int
        Triangles.
    diffusion_length : float
        Diffusion length of the heat flow, in root areas.
    extended : bool
        Whether borders are extended first.

    Attributes
    ----------
    root_area : float
        Square root of the surface's area, in which all distances are given.

    Raises
    ------
    CapacityError
        If the surface is too degenerate to solve on.

    References
    ----------
    .. [1] K. Crane, C. Weischedel, M. Wardetzky, "Geodesics in heat", ACM Transactions on
       Graphics 32 (2013). doi:10.1145/2516971.2516977
    """

    def __init__(
        self,
        V: FloatArray,
        F: IntArray,
        *,
        diffusion_length: float = DIFFUSION_LENGTH,
        extended: bool = True,
    ) -> None:
        import potpourri3d as pp3d

        self.root_area = float(np.sqrt(face_areas(V, F).sum()))
        if self.root_area == 0.0:
            raise CapacityError("the surface has no area")
        self._n = len(V)
        U = (V - V.mean(axis=0)) / self.root_area
        if extended:
            U, F = extend_boundary(U, F, EXTENSION_WIDTH, MIN_BORDER_LENGTH)
        E = edges(F)
        mean_edge = float(lengths(U[E[:, 0]] - U[E[:, 1]]).mean())
        try:
            # The solver takes time in squared mean edges.
            self._solver = pp3d.MeshHeatMethodDistanceSolver(
                U, F, (diffusion_length / mean_edge) ** 2, True
            )
        except (RuntimeError, ValueError) as error:
            raise CapacityError(f"distances cannot be measured: {_first_line(error)}") from error

    def from_vertex(self, source: int) -> FloatArray:
        """Measure from one vertex to all, (N,) float64, in root areas."""
        try:
            d = np.asarray(self._solver.compute_distance(int(source)), dtype=np.float64)
        except RuntimeError as error:
            raise CapacityError(f"distances cannot be measured: {_first_line(error)}") from error
        if not np.all(np.isfinite(d)):
            raise CapacityError("distances cannot be measured: the surface is too degenerate")
        return np.maximum(d - d[source], 0.0)[: self._n]

    def from_vertices(self, sources: IntArray) -> FloatArray:
        """Measure from each of several vertices, (S, N) float64, in root areas."""
        return np.array([self.from_vertex(int(source)) for source in sources])


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
