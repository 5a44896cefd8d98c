"""Anchors: the tips of a shape's protrusions, found from one frame alone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshmark.geometry import vertex_areas
from meshmark.topology import boundary_edges
from meshmark_plugins.schemes.apex.persistence import Maxima, persistent_maxima
from meshmark_plugins.schemes.apex.radial import RadialDistances

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SAMPLES = 16


def integral_distance(V: FloatArray, F: IntArray, radial: RadialDistances) -> FloatArray:
    """Mean distance of each vertex to the whole surface, (N,) float64, in root areas.

    Notes
    -----
    Hilaga's function [1]_: high at the tips of whatever sticks out, the same in every pose that
    keeps distances. Sixteen samples stand for the surface, each the farthest from the earlier
    ones, weighted by the area nearest to it.

    References
    ----------
    .. [1] M. Hilaga, Y. Shinagawa, T. Kohmura, T. L. Kunii, "Topology matching for fully
       automatic similarity estimation of 3D shapes", SIGGRAPH 2001. doi:10.1145/383259.383282
    """
    areas = vertex_areas(V, F)
    centroid = areas @ V / areas.sum()
    middle = int(np.argmin(np.sum((V - centroid) ** 2, axis=1)))
    sample = int(np.argmax(radial.from_vertex(middle)))
    rows = [radial.from_vertex(sample)]
    nearest = rows[0]
    for _ in range(SAMPLES - 1):
        rows.append(radial.from_vertex(int(np.argmax(nearest))))
        nearest = np.minimum(nearest, rows[-1])
    D = np.array(rows)
    weights = np.bincount(D.argmin(axis=0), areas, SAMPLES)
    mean: FloatArray = weights @ D / weights.sum()
    return mean


def find_anchors(
    V: FloatArray, F: IntArray, radial: RadialDistances, least: float, most: int
) -> Maxima:
    """Find the tips of a connected surface, those that stand out most first.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    radial : RadialDistances
        The surface's distances.
    least : float
        Least persistence of the integral distance, in root areas.
    most : int
        Most anchors to return.
    """
    found = persistent_maxima(integral_distance(V, F, radial), F, least)
    return Maxima(found.vertices[:most], found.persistence[:most])


def distance_to_border(V: FloatArray, F: IntArray, vertices: IntArray) -> FloatArray:
    """Straight distance of vertices from the surface's border, (m,) float64; inf without one."""
    border = np.unique(boundary_edges(F))
    if border.size == 0:
        return np.full(len(vertices), np.inf)
    gaps = V[vertices][:, None] - V[border][None]
    return np.linalg.norm(gaps, axis=2).min(axis=1)
