"""A triangle mesh as a surface: points spread over it, and the closest of its points to others."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.closest_in_triangle import closest_in_triangle
from meshmark.mesh.geometry import face_areas, lengths
from meshmark.mesh.surface_walk import walk_to_closest
from meshmark.mesh.triangle_search import TriangleSearch, triangle_search


class ClosestPoints:
    """Built once on a mesh, asked many times for the closest points of its surface.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles, at least one.
    order : (F,) int, optional
        Their `search_order` in any pose; building takes less time with it.

    Notes
    -----
    The closest triangle is found in coordinates that put the mesh into the unit cube about the
    origin: by compiled loops, or without numba by open3d in single precision. Near ties between
    triangles the distance then errs by about 1e-7 of the mesh's extent at worst. The point in the
    triangle is always computed in double precision.
    """

    def __init__(self, V: FloatArray, F: IntArray, order: IntArray | None = None) -> None:
        self.V, self.F, self._order = V, F, order

    def find(self, Q: FloatArray) -> tuple[IntArray, FloatArray]:
        """Find the closest point of the surface to each query.

        Parameters
        ----------
        Q : (n, 3) float64
            Query points.

        Returns
        -------
        face : (n,) int
            Triangle each closest point lies in.
        weights : (n, 3) float64
            Its barycentric coordinates there.
        """
        face = self.faces(Q)
        return face, closest_in_triangle(Q, *self._corners(face))

    def faces(
        self, Q: FloatArray, near: IntArray | None = None, tolerance: FloatArray | None = None
    ) -> IntArray:
        """Find the triangle that is closest to each query, or one within a tolerance, (n,) int.

        Parameters
        ----------
        near : (n,) int, optional
            A triangle near each query, to walk over the surface from.
        tolerance : (n,) float64, optional
            Given with `near`: where a walk ends farther from its query than this, all triangles
            are searched, which takes seven times as long. It may end early where the surface
            bends.
        """
        if near is None or tolerance is None:
            return self._search.closest(self._local(Q))
        face = walk_to_closest(self.V, self.F, Q, near, tolerance)
        lost = face < 0
        if lost.any():
            face[lost] = self.faces(Q[lost])
        return face

    def points(self, Q: FloatArray) -> FloatArray:
        """Compute the closest point of the surface to each query, (n, 3)."""
        return self.points_in(self.faces(Q), Q)

    def points_in(self, face: IntArray, Q: FloatArray) -> FloatArray:
        """Compute the point of triangle `face[i]` that is closest to query i, (n, 3)."""
        a, b, c = self._corners(face)
        u, v, w = closest_in_triangle(Q, a, b, c).T[:, :, None]
        return u * a + v * b + w * c

    def distances(self, Q: FloatArray) -> FloatArray:
        """Compute the distance of each query from the surface, (n,)."""
        return lengths(self.points(Q) - Q)

    @cached_property
    def _search(self) -> TriangleSearch:
        return triangle_search(self._local(self.V), self.F, self._order)

    @cached_property
    def _cube(self) -> tuple[FloatArray, float]:
        """Centre and side of the cube about the mesh."""
        # Points that no triangle uses must not cost precision.
        used = np.zeros(len(self.V), dtype=bool)
        used[self.F.ravel()] = True
        corners = self.V[used].T
        # Column by column: a reduction over axes this long takes several times as long.
        low, high = (np.array([end(x) for x in corners]) for end in (np.min, np.max))
        return (low + high) / 2, float((high - low).max()) or 1.0

    def _corners(self, face: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        a, b, c = (self.V[i] for i in self.F[face].T)
        return a, b, c

    def _local(self, P: FloatArray) -> FloatArray:
        centre, side = self._cube
        return (P - centre) / side


def sample_surface(V: FloatArray, F: IntArray, n: int, rng: np.random.Generator) -> FloatArray:
    """Spread points over a surface, evenly by area; by faces where there is no area.

    Faces are visited in order with one sample for each n-th of the area (systematic sampling),
    which spreads them better than independent draws would.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    n : int
        Number of points.
    rng : numpy.random.Generator
        Places them within their stretch of area and within their face.

    Returns
    -------
    (n, 3) float64
        Points of the surface.
    """
    face, weights = surface_samples(V, F, n, rng)
    return np.einsum("ij,ijk->ik", weights, V[F[face]])


def surface_samples(
    V: FloatArray, F: IntArray, n: int, rng: np.random.Generator
) -> tuple[IntArray, FloatArray]:
    """Choose what `sample_surface` returns, as points that can be found in other poses, too.

    Returns
    -------
    face : (n,) int
        Triangle each point lies in.
    weights : (n, 3) float64
        Its barycentric coordinates there.
    """
    area = face_areas(V, F)
    if not area.any():
        # Crushed into a line or a point.
        area = np.ones(len(F))
    place = (np.arange(n) + rng.random(n)) / n
    reached = np.cumsum(area) / area.sum()
    face = np.minimum(np.searchsorted(reached, place, side="right"), len(F) - 1)
    # Folding the unit square along its diagonal makes it a triangle.
    u, v = rng.random((2, n))
    over = u + v > 1
    u[over], v[over] = 1 - u[over], 1 - v[over]
    return face, np.stack([1 - u - v, u, v], axis=1)
