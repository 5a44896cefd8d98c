"""Geodesic distances that do not depend on how finely the surface is meshed."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.geometry import face_areas, lengths
from meshmark.mesh.heat_distances import HeatDistances, HeatTopology, heat_topology
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
    topology : HeatTopology, optional
        Of these triangles, as of `distance_topology`, where many poses of them are measured: then
        loops are used that are compiled.

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
        topology: HeatTopology | None = None,
    ) -> None:
        self.root_area = float(np.sqrt(face_areas(V, F).sum()))
        if self.root_area == 0.0:
            raise CapacityError("the surface has no area")
        self._n = len(V)
        U = (V - V.mean(axis=0)) / self.root_area
        if extended:
            U, F = extend_boundary(U, F, EXTENSION_WIDTH, MIN_BORDER_LENGTH)
        E = edges(F)
        mean_edge = float(lengths(U[E[:, 0]] - U[E[:, 1]]).mean())
        # Solvers take the length of diffusion in mean edges.
        diffusion = diffusion_length / mean_edge
        self._compiled = compiled_distances(topology, U, F, diffusion, in_sides=True)
        if self._compiled is None:
            self._solver = _robust_solver(U, F, diffusion)

    def from_vertex(self, source: int) -> FloatArray:
        """Measure from one vertex to all, (N,) float64, in root areas."""
        if self._compiled is not None:
            return self.from_vertices(np.array([source]))[0]
        try:
            d = np.asarray(self._solver.compute_distance(int(source)), dtype=np.float64)
        except RuntimeError as error:
            raise CapacityError(f"distances cannot be measured: {_first_line(error)}") from error
        return self._from_zero(d, source)

    def from_vertices(self, sources: IntArray) -> FloatArray:
        """Measure from each of several vertices, (S, N) float64, in root areas."""
        if self._compiled is None:
            return np.array([self.from_vertex(int(source)) for source in sources])
        found = self._compiled.from_vertices(sources)
        return np.array([self._from_zero(d, v) for d, v in zip(found, sources, strict=True)])

    def _from_zero(self, d: FloatArray, source: int) -> FloatArray:
        if not np.all(np.isfinite(d)):
            raise CapacityError("distances cannot be measured: the surface is too degenerate")
        return np.maximum(d - d[source], 0.0)[: self._n]


def distance_topology(V: FloatArray, F: IntArray) -> HeatTopology | None:
    """Prepare measuring distances on many poses of a surface, V (N, 3) being one of them."""
    root_area = np.sqrt(face_areas(V, F).sum())
    if root_area == 0.0:
        return None
    return heat_topology(*extend_boundary(V / root_area, F, EXTENSION_WIDTH, MIN_BORDER_LENGTH))


def compiled_distances(
    topology: HeatTopology | None, U: FloatArray, F: IntArray, diffusion: float, in_sides: bool
) -> HeatDistances | None:
    """Use compiled loops where they can be used: the borders of another pose may be extended.

    See `HeatTopology.distances`.
    """
    if topology is None or not np.array_equal(F, topology.F):
        return None
    try:
        return topology.distances(U, diffusion, in_sides)
    except RuntimeError:
        return None


def _robust_solver(U: FloatArray, F: IntArray, diffusion: float) -> Any:
    import potpourri3d as pp3d

    try:
        return pp3d.MeshHeatMethodDistanceSolver(U, F, diffusion**2, True)
    except (RuntimeError, ValueError) as error:
        raise CapacityError(f"distances cannot be measured: {_first_line(error)}") from error


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
