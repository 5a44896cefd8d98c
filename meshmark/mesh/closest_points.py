"""A triangle mesh as a surface: points spread over it, and the closest of its points to others."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.closest_in_triangle import closest_in_triangle
from meshmark.mesh.geometry import face_areas, lengths
from meshmark.mesh.surface_walk import walk_to_closest
from meshmark.mesh.triangle_search import triangle_search


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
        self.V, self.F = V, F
        # Points that no triangle uses must not cost precision.
        used = np.zeros(len(V), dtype=bool)
        used[F.ravel()] = True
        corners = V[used].T
        # Column by column: a reduction over axes this long takes several times as long.
        low, high = (np.array([end(x) for x in corners]) for end in (np.min, np.max))
        self._centre = (low + high) / 2
        self._scale = float((high - low).max()) or 1.0
        self._search = triangle_search(self._local(V), F, order)

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

    def faces(self, Q: FloatArray) -> IntArray:
        """Find the triangle that is closest to each query, (n,) int."""
        return self._search.closest(self._local(Q))

    def faces_near(self, Q: FloatArray, near: IntArray, tolerance: FloatArray) -> IntArray:
        """Find triangles that are closest to queries, or within a tolerance, by walks, (n,) int.

        Parameters
        ----------
        near : (n,) int
            A triangle near each query, to walk over the surface from. Walks end early where the
            surface bends.
        tolerance : (n,) float64
            Where a walk ends farther from its query than this, all triangles are searched, which
            takes seven times as long.
        """
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

    def _corners(self, face: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        a, b, c = (self.V[i] for i in self.F[face].T)
        return a, b, c

    def _local(self, P: FloatArray) -> FloatArray:
        return (P - self._centre) / self._scale


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
