"""Moves of vertices along the surface they lie on."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import vertex_normals


def tangential(V: FloatArray, F: IntArray, D: FloatArray) -> FloatArray:
    """Take what lies along the vertices' normals out of displacements, (N, 3)."""
    n = vertex_normals(V, F)
    return D - np.einsum("ij,ij->i", D, n)[:, None] * n


def slide(surface: ClosestPoints, V: FloatArray, D: FloatArray) -> FloatArray:
    """Move vertices, and put those that moved back on the surface.

    Parameters
    ----------
    surface : ClosestPoints
        The surface.
    V, D : (N, 3) float64
        Vertices on it, and their displacements.

    Returns
    -------
    (N, 3) float64
        Points of the surface; a vertex whose displacement is 0 stays, wherever it is.
    """
    moving = D.any(axis=1)
    points = V.copy()
    points[moving] = surface.points((V + D)[moving])
    return points
