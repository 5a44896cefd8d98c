"""Anchors: the tips of a shape's protrusions, found from one frame alone."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import vertex_areas
from meshmark.mesh.topology import boundary_edges, vertex_adjacency
from meshmark_plugins.schemes.apex.anchors.geodesics import RadialDistances
from meshmark_plugins.schemes.apex.anchors.persistence import Maxima, persistent_maxima

SAMPLES = 16
# How far below a maximum its cap reaches, in root areas.
CAP = 0.03


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
    return weights @ D / weights.sum()


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
    f = integral_distance(V, F, radial)
    found = persistent_maxima(f, F, least)
    centred = centre_of_caps(V, F, f, found.vertices[:most])
    return Maxima(centred, found.persistence[:most])


def centre_of_caps(V: FloatArray, F: IntArray, f: FloatArray, maxima: IntArray) -> IntArray:
    """Move each maximum to the middle of its cap, where f falls short of it by `CAP` at most.

    The tip of a hoof or a hand is blunt: which of its vertices is the highest is decided by a
    hair, and another one in the next pose. The middle of the tip stays.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    f : (N,) float64
        The function.
    maxima : (m,) int
        Its maxima.

    Returns
    -------
    (m,) int
        The vertex of each cap that is nearest to its centre of gravity; a maximum on a border
        stays there, and can be told from a tip.
    """
    areas = vertex_areas(V, F)
    adjacency = vertex_adjacency(F, len(V))
    border = np.zeros(len(V), dtype=bool)
    border[boundary_edges(F)] = True
    centres = [
        int(top) if border[top] else _centre(V, f, areas, adjacency, int(top)) for top in maxima
    ]
    return np.array(centres, dtype=np.int64)


def _centre(
    V: FloatArray, f: FloatArray, areas: FloatArray, adjacency: csr_matrix, top: int
) -> int:
    high = np.flatnonzero(f >= f[top] - CAP)
    label = connected_components(adjacency[high][:, high], directed=False)[1]
    cap = high[label == label[np.searchsorted(high, top)]]
    centre = areas[cap] @ V[cap] / areas[cap].sum()
    return int(cap[np.argmin(np.sum((V[cap] - centre) ** 2, axis=1))])


def distance_to_border(V: FloatArray, F: IntArray, vertices: IntArray) -> FloatArray:
    """Straight distance of vertices from the surface's border, (m,) float64; inf without one."""
    border = np.unique(boundary_edges(F))
    if border.size == 0:
        return np.full(len(vertices), np.inf)
    gaps = V[vertices][:, None] - V[border][None]
    return np.linalg.norm(gaps, axis=2).min(axis=1)
