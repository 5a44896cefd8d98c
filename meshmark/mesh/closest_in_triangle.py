"""Closest points of single triangles and their planes, in barycentric coordinates."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import BoolArray, FloatArray
from meshmark.kernels import compiled
from meshmark.mesh.geometry import FLAT


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


def plane_weights(
    P: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray
) -> tuple[FloatArray, BoolArray]:
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
