"""Geodesic distances that are measured on a proxy of the surface."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.factors import SymmetricFactor
from meshmark.mesh.geometry import area_vectors, face_areas, lengths, normalized, vertex_areas
from meshmark.mesh.heat_distances import POISSON_SHIFT, HeatTopology
from meshmark.mesh.laplacian import stiffness_matrix
from meshmark.mesh.proxy import Proxy
from meshmark.mesh.topology import vertex_components
from meshmark_plugins.schemes.apex.anchors.boundary_extension import extend_boundary
from meshmark_plugins.schemes.apex.anchors.geodesics import (
    DIFFUSION_LENGTH,
    EXTENSION_WIDTH,
    MIN_BORDER_LENGTH,
    GeodesicDistances,
    compiled_distances,
)

# Smallest area, as a share of the mean one, that a triangle counts with. Cotangents are not bounded
# otherwise: without those of obtuse angles, distances would be too short.
MIN_TRIANGLE_AREA_SHARE = 1e-3
# Radius, in mean distances between a proxy's vertices, of the patch about a source on which
# distances are measured on the mesh itself, too, and the ring of it in which the two are compared.
PATCH_RADIUS, RING = 7.0, (2.0, 6.0)
# Diffusion length on the patch, in its own root areas.
PATCH_DIFFUSION_LENGTH = 0.4
# A patch whose area is larger than this times that of the proxy under it is full of noise, which
# makes ways longer.
MAX_ROUGHNESS = 1.1


class EvenMeshDistances:
    """Heat-method distances [1]_ on a mesh of even triangles, such as a proxy.

    Parameters
    ----------
    V : (n, 3) float64
        Vertex positions of one connected surface.
    F : (f, 3) int
        Triangles, turned alike.
    unit : float
        Length in which distances are given.
    order : (n,) int, optional
        An order of the vertices in which factors stay sparse, if one is known.
    topology : HeatTopology, optional
        Of these triangles; see `GeodesicDistances`.

    Raises
    ------
    CapacityError
        If the surface is too degenerate to solve on.

    Notes
    -----
    The diffusion length and the extension of borders are those of `GeodesicDistances`. The heat
    flow makes a blunt tip of the cone that distance is; so what is interpolated between the corners
    about a source is corrected by their straight distances from it.

    References
    ----------
    .. [1] K. Crane, C. Weischedel, M. Wardetzky, "Geodesics in heat", ACM Transactions on
       Graphics 32 (2013). doi:10.1145/2516971.2516977
    """

    def __init__(
        self,
        V: FloatArray,
        F: IntArray,
        unit: float,
        order: IntArray | None = None,
        topology: HeatTopology | None = None,
    ) -> None:
        root_area = float(np.sqrt(face_areas(V, F).sum()))
        if root_area == 0.0:
            raise CapacityError("the surface has no area")
        self._V, self._units = (V - V.mean(axis=0)) / root_area, root_area / unit
        U, F = extend_boundary(self._V, F, EXTENSION_WIDTH, MIN_BORDER_LENGTH)
        # What a border was extended by is in no order.
        order = None if len(U) > len(V) else order
        compiled = compiled_distances(topology, U, F, DIFFUSION_LENGTH, in_sides=False)
        self._solver = _EvenSolver(U, F, order) if compiled is None else compiled

    def from_vertex(self, source: int) -> FloatArray:
        """Measure from one vertex to all, (n,) float64, in units."""
        return self.from_points([(np.array([source]), np.ones(1))])[0]

    def from_points(self, points: list[tuple[IntArray, FloatArray]]) -> FloatArray:
        """Measure from points in triangles to all vertices, (S, n) float64, in units.

        Parameters
        ----------
        points : list of ((k,) int, (k,) float64)
            Of each, the corners of its triangle, or those of them that matter, and its barycentric
            coordinates, summing to 1.
        """
        heat = np.zeros((len(points), self._solver.n_points))
        for row, (corners, shares) in zip(heat, points, strict=True):
            row[corners] = shares
        found = self._solver.from_sources(heat)[:, : len(self._V)]
        if not np.all(np.isfinite(found)):
            raise CapacityError("distances cannot be measured: the surface is too degenerate")
        for d, (corners, shares) in zip(found, points, strict=True):
            V = self._V[corners]
            d += shares @ lengths(V - shares @ V) - shares @ d[corners]
        return self._units * np.maximum(found, 0.0)


class _EvenSolver:
    """Distances by plain cotangent weights; see `HeatDistances`, which does the same."""

    def __init__(self, U: FloatArray, F: IntArray, order: IntArray | None) -> None:
        self.n_points = len(U)
        mass = diags_array(vertex_areas(U, F))
        L = stiffness_matrix(F, _half_cotangents(U, F), len(U))
        try:
            self._heat = SymmetricFactor(mass + DIFFUSION_LENGTH**2 * L, order)
            self._poisson = SymmetricFactor(L + POISSON_SHIFT * mass, order)
        except RuntimeError as error:
            raise CapacityError("distances cannot be measured: a singular matrix") from error
        self._gradient = _scaled_gradient(U, F)
        self._divergence = csr_matrix(self._gradient.T)

    def from_sources(self, heat: FloatArray) -> FloatArray:
        """Measure distances from where heat (S, N) is, up to a constant, (S, N)."""
        return np.array([self._from_source(row) for row in heat])

    def _from_source(self, heat: FloatArray) -> FloatArray:
        slope = (self._gradient @ self._heat.solve(heat)).reshape(-1, 3)
        away = -normalized(slope).ravel()
        d: FloatArray = self._poisson.solve(0.5 * (self._divergence @ away))
        return d


class ProxyDistances:
    """Geodesic distances of a surface, measured on a proxy of it; see `GeodesicDistances`.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions of one connected surface; no vertex is unused.
    F : (F, 3) int
        Triangles.
    proxy : Proxy
        Of the surface.
    topology : HeatTopology, optional
        Of the proxy; see `GeodesicDistances`.
    surpluses : callable, optional
        Tells how much too long distances from vertices (S,) are near them, (S,). It hardly depends
        on the pose, by a hundredth of a bin: the method of this name does, in another one.

    Attributes
    ----------
    root_area : float
        Square root of the surface's area, in which all distances are given.
    V : (n, 3) float64
        Positions of the proxy.
    on_proxy : EvenMeshDistances
        Distances from its vertices.

    Raises
    ------
    CapacityError
        If the surface is too degenerate to solve on.
    """

    def __init__(
        self,
        V: FloatArray,
        F: IntArray,
        proxy: Proxy,
        topology: HeatTopology | None = None,
        surpluses: Callable[[IntArray], FloatArray] | None = None,
    ) -> None:
        self.root_area = float(np.sqrt(face_areas(V, F).sum()))
        if self.root_area == 0.0:
            raise CapacityError("the surface has no area")
        self.proxy, self.V = proxy, proxy.fit(V)
        self.on_proxy = EvenMeshDistances(
            self.V, proxy.faces, self.root_area, proxy.order, topology
        )
        self._of_mesh = V / self.root_area, F
        self._surpluses = surpluses
        own_area = face_areas(self.V, proxy.faces).sum()
        self._spacing = float(np.sqrt(own_area / len(self.V))) / self.root_area

    def from_vertex(self, source: int) -> FloatArray:
        """Measure from one vertex to all, (N,) float64, in root areas."""
        return self.from_vertices(np.array([source]))[0]

    def from_vertices(self, sources: IntArray) -> FloatArray:
        """Measure from each of several vertices, (S, N) float64, in root areas."""
        return self.proxy.prolong(self.to_proxy(sources))

    def to_proxy(self, sources: IntArray) -> FloatArray:
        """Measure from each of several vertices to those of the proxy, (S, n), in root areas."""
        found = self._uncorrected(sources)
        if self._surpluses is None:
            surpluses = self._measure_surpluses(sources, found)
        else:
            surpluses = self._surpluses(sources)
        return np.maximum(found - surpluses[:, None], 0.0)

    def surpluses(self, sources: IntArray) -> FloatArray:
        """Measure by how much distances from vertices (S,) are too long near them, (S,)."""
        return self._measure_surpluses(sources, self._uncorrected(sources))

    def _uncorrected(self, sources: IntArray) -> FloatArray:
        at = [self.proxy.prolongation[[source]] for source in sources.tolist()]
        return self.on_proxy.from_points([(row.indices, row.data) for row in at])

    def _measure_surpluses(self, sources: IntArray, found: FloatArray) -> FloatArray:
        return np.array(
            [
                self._surplus(source, self.proxy.prolongation @ d)
                for source, d in zip(sources.tolist(), found, strict=True)
            ]
        )

    def _surplus(self, source: int, d: FloatArray) -> float:
        """Find by how much d (N,), from a source, is longer near it than on the mesh itself.

        There the proxy is coarse, and every distance inherits the error.
        """
        V, F = self._of_mesh
        vertices, faces = _patch(F, d < PATCH_RADIUS * self._spacing, source)
        on_proxy = (self.proxy.prolongation[vertices] @ self.V) / self.root_area
        areas = face_areas(V[vertices], faces).sum(), face_areas(on_proxy, faces).sum()
        if not len(faces) or areas[0] > MAX_ROUGHNESS * areas[1]:
            return 0.0
        try:
            patch = GeodesicDistances(
                V[vertices], faces, diffusion_length=PATCH_DIFFUSION_LENGTH, extended=False
            )
            near = patch.root_area * patch.from_vertex(int(np.searchsorted(vertices, source)))
        except CapacityError:
            return 0.0
        ring = (near > RING[0] * self._spacing) & (near < RING[1] * self._spacing)
        weights = ring * vertex_areas(V[vertices], faces)
        return float(weights @ (d[vertices] - near) / weights.sum()) if weights.any() else 0.0


def _patch(F: IntArray, inside: NDArray[np.bool_], source: int) -> tuple[IntArray, IntArray]:
    """Cut the triangles about a vertex that are inside: vertices (k,), and triangles of those."""
    a, b, c = F.T
    faces = F[inside[a] & inside[b] & inside[c]]
    vertices, local = np.unique(faces, return_inverse=True)
    local = local.reshape(-1, 3)
    at = int(np.searchsorted(vertices, source))
    if at == len(vertices) or vertices[at] != source:
        return np.empty(0, dtype=np.int64), np.empty((0, 3), dtype=np.int64)
    label = vertex_components(local, len(vertices))
    faces = faces[label[local[:, 0]] == label[at]]
    vertices, local = np.unique(faces, return_inverse=True)
    return vertices, local.reshape(-1, 3)


def _half_cotangents(V: FloatArray, F: IntArray) -> FloatArray:
    """Half the cotangent of the angle at each corner, (F, 3) float64, as it is."""
    double_areas = 2.0 * face_areas(V, F)
    double_areas = np.maximum(double_areas, MIN_TRIANGLE_AREA_SHARE * double_areas.mean())
    sides = [V[F[:, k - 1]] - V[F[:, k - 2]] for k in range(3)]
    return np.stack(
        [-0.5 * np.vecdot(sides[k - 1], sides[k - 2]) / double_areas for k in range(3)], axis=1
    )


def _scaled_gradient(V: FloatArray, F: IntArray) -> csr_matrix:
    """Gradients in triangles times twice the areas, of values at vertices, (3 F, N) sparse."""
    normals = normalized(area_vectors(V, F))
    across = np.stack(
        [np.cross(normals, V[F[:, k - 1]] - V[F[:, k - 2]]) for k in range(3)], axis=2
    )
    start = 3 * np.arange(3 * len(F) + 1)
    return csr_matrix(
        (across.ravel(), np.repeat(F, 3, axis=0).ravel(), start), (3 * len(F), len(V))
    )
