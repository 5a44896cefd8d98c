"""A triangle mesh as a surface: points spread over it, and the closest of its points to others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.geometry import FLAT, area_vectors, face_areas, lengths, normalized
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
        self._V, self._F = V, F
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

    def points(self, Q: FloatArray) -> FloatArray:
        """Compute the closest point of the surface to each query, (n, 3)."""
        return self.points_in(self.faces(Q), Q)

    def points_in(self, face: IntArray, Q: FloatArray) -> FloatArray:
        """Compute the point of triangle `face[i]` that is closest to query i, (n, 3)."""
        a, b, c = self._corners(face)
        u, v, w = closest_in_triangle(Q, a, b, c).T[:, :, None]
        return u * a + v * b + w * c

    def planes(self, face: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return a point and the unit normal, 0 without area, of triangles (n,), (n, 3) each."""
        normals = normalized(area_vectors(self._V, self._F))
        return self._V[self._F[face, 0]], normals[face]

    def distances(self, Q: FloatArray) -> FloatArray:
        """Compute the distance of each query from the surface, (n,)."""
        return lengths(self.points(Q) - Q)

    def _corners(self, face: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        a, b, c = (self._V[i] for i in self._F[face].T)
        return a, b, c

    def _local(self, P: FloatArray) -> FloatArray:
        return (P - self._centre) / self._scale


@compiled
def closest_in_triangle(P: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Compute barycentric coordinates of the point of triangle i closest to point i.

    Parameters
    ----------
    P, a, b, c : (n, 3) float64
        Points, and the corners of a triangle for each; triangles without area will do.

    Returns
    -------
    (n, 3) float64
        Weights of a, b and c, none negative, summing to 1.
    """
    weights, flat = plane_weights(P, a, b, c)
    outside = flat | (weights.min(axis=1) < 0)
    # Where the foot of the perpendicular is outside, the closest point lies on an edge.
    weights[outside] = closest_on_edges(P[outside], a[outside], b[outside], c[outside])
    return weights


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


def plane_weights(
    P: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Compute barycentric coordinates of the feet of perpendiculars on the triangles' planes.

    Parameters
    ----------
    P, a, b, c : (n, 3) float64
        Points, and the corners of a triangle for each.

    Returns
    -------
    weights : (n, 3) float64
        Weights of a, b and c, summing to 1; some are negative where the foot lies outside.
    flat : (n,) bool
        Triangles without area, which have no plane: their weights say nothing.
    """
    u, v, w = b - a, c - a, P - a
    uu, uv, vv = _dot(u, u), _dot(u, v), _dot(v, v)
    wu, wv = _dot(w, u), _dot(w, v)
    determinant = uu * vv - uv**2
    flat = determinant <= FLAT * uu * vv
    safe = np.where(flat, 1.0, determinant)
    s = (vv * wu - uv * wv) / safe
    t = (uu * wv - uv * wu) / safe
    return np.stack([1 - s - t, s, t], axis=1), flat


def closest_on_edges(P: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Compute barycentric coordinates of the closest points of the triangles' borders."""
    t = [_segment_weights(P, *ends) for ends in ((a, b), (b, c), (c, a))]
    zero = np.zeros(len(P))
    candidates = np.stack(
        [
            np.stack([1 - t[0], t[0], zero], axis=1),
            np.stack([zero, 1 - t[1], t[1]], axis=1),
            np.stack([t[2], zero, 1 - t[2]], axis=1),
        ]
    )
    points = np.einsum("kij,ijx->kix", candidates, np.stack([a, b, c], axis=1))
    nearest = np.argmin(np.sum((points - P) ** 2, axis=2), axis=0)
    return candidates[nearest, np.arange(len(P))]


def _segment_weights(P: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Compute how far along a segment its closest point is, in [0, 1]."""
    u = b - a
    uu = _dot(u, u)
    t = np.divide(_dot(P - a, u), uu, out=np.zeros(len(P)), where=uu > 0)
    return np.clip(t, 0.0, 1.0)


def _dot(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.einsum("ij,ij->i", x, y)
