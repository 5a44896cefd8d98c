"""Local maxima of a function on a mesh, and their persistence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.topology import edges

# Least persistence of an anchor that is marked, and of one that is detected; in root areas.
MIN_PERSISTENCE_MARKED, MIN_PERSISTENCE_DETECTED = 0.10, 0.06


@dataclass(frozen=True, eq=False)
class Maxima:
    """Local maxima, the most persistent first.

    Parameters
    ----------
    vertices : (m,) int
        Where they are.
    persistence : (m,) float64
        How far the function falls before a higher maximum can be reached; for the highest one
        of all, its whole range.
    """

    vertices: IntArray
    persistence: FloatArray

    def subset(self, kept: NDArray[np.bool_]) -> Maxima:
        """Select the maxima that are kept, (m,) bool."""
        return Maxima(self.vertices[kept], self.persistence[kept])


def persistent_maxima(f: FloatArray, F: IntArray, min_persistence: float) -> Maxima:
    """Find the local maxima of f with 0-dimensional persistence of at least `min_persistence`.

    Parameters
    ----------
    f : (N,) float64
        Function values at the vertices of a connected mesh.
    F : (F, 3) int
        Triangles.
    min_persistence : float
        Smallest persistence to report.

    Notes
    -----
    As the level falls, the components of the superlevel set grow. Where two meet, the lower
    maximum dies (the elder rule [1]_), of equal ones the one with the higher index. Every vertex
    belongs to the maximum that steepest ascent leads to, so that only the highest passes between
    these basins have to be looked at.

    References
    ----------
    .. [1] H. Edelsbrunner, D. Letscher, A. Zomorodian, "Topological persistence and
       simplification", Discrete & Computational Geometry 28 (2002).
       doi:10.1007/s00454-002-2885-2
    """
    n = len(f)
    order = np.lexsort((np.arange(n), -f))
    rank = np.empty(n, dtype=np.int64)
    rank[order] = np.arange(n)
    E = edges(F)
    basin = _basins(order, rank, E)
    level = f[E].min(axis=1)
    a, b = np.sort(basin[E], axis=1).T
    crossing = np.flatnonzero(a != b)
    by_height = crossing[np.argsort(-level[crossing], kind="stable")]
    # The first pass between two basins is the highest; later ones cannot join anything new.
    _, first = np.unique(a[by_height] * n + b[by_height], return_index=True)
    passes = by_height[np.sort(first)]
    died = _elder_rule(np.unique(basin), a[passes], b[passes], level[passes], f[order])
    ranks = np.array([r for r, p in died.items() if p >= min_persistence], dtype=np.int64)
    persistence = np.array([died[int(r)] for r in ranks])
    by_persistence = np.lexsort((ranks, -persistence))
    return Maxima(order[ranks[by_persistence]], persistence[by_persistence])


def _basins(order: IntArray, rank: IntArray, E: IntArray) -> IntArray:
    """Rank of the maximum that steepest ascent from each vertex leads to, (N,) int."""
    best = rank.copy()
    np.minimum.at(best, E[:, 0], rank[E[:, 1]])
    np.minimum.at(best, E[:, 1], rank[E[:, 0]])
    up = order[best]
    while np.any(up != up[up]):
        up = up[up]
    return rank[up]


def _elder_rule(
    maxima: IntArray, a: IntArray, b: IntArray, level: FloatArray, height: FloatArray
) -> dict[int, float]:
    """Pair maxima with the passes where they die; maxima are few, so that a plain loop will do.

    Returns
    -------
    dict of int to float
        Persistence of each maximum, by its rank.
    """
    parent = {int(m): int(m) for m in maxima}

    def root(m: int) -> int:
        while parent[m] != m:
            m = parent[m]
        return m

    persistence = {int(maxima[0]): float(height[0] - height[-1])}
    for i, j, at in zip(a.tolist(), b.tolist(), level.tolist(), strict=True):
        elder, younger = sorted((root(i), root(j)))
        if elder != younger:
            parent[younger] = elder
            persistence[younger] = float(height[younger] - at)
    return persistence
