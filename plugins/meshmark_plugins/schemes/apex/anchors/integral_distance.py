"""The mean distance of every point to the whole surface, which is highest at tips."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import vertex_areas
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances
from meshmark_plugins.schemes.apex.anchors.proxy_distances import EvenMeshDistances

# Samples that stand for the surface.
SURFACE_SAMPLES = 16


def integral_distance(
    V: FloatArray, F: IntArray, geodesics: GeodesicDistances | EvenMeshDistances
) -> FloatArray:
    """Mean distance of each vertex to the whole surface, (N,) float64, in units of `geodesics`.

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
    sample = int(np.argmax(geodesics.from_vertex(middle)))
    rows = [geodesics.from_vertex(sample)]
    nearest = rows[0]
    for _ in range(SURFACE_SAMPLES - 1):
        rows.append(geodesics.from_vertex(int(np.argmax(nearest))))
        nearest = np.minimum(nearest, rows[-1])
    D = np.array(rows)
    weights = np.bincount(D.argmin(axis=0), areas, SURFACE_SAMPLES)
    return weights @ D / weights.sum()
