"""Extension of a surface beyond its border."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import lengths, normalized, sum_at_corners
from meshmark.mesh.topology import boundary_edges, graph_components

# Rings of triangles that the strip consists of.
STRIP_RINGS = 3
# Rounds in which outward directions are averaged along the border: what a cut leaves is a saw's
# teeth.
DIRECTION_SMOOTHING_ROUNDS = 10


def extend_boundary(
    V: FloatArray, F: IntArray, width: float, min_length: float = 0.0
) -> tuple[FloatArray, IntArray]:
    """Extend a surface beyond its borders by a strip that goes straight on.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles, turned alike; their borders need not be simple loops.
    width : float
        Width of the strip, in the lengths of `V`.
    min_length : float
        Shorter borders, such as that of a nostril, are left alone.

    Returns
    -------
    V : (N + B STRIP_RINGS, 3) float64
        The same vertices, then copies of the B on those borders, moved outwards.
    F : (F + 2 E STRIP_RINGS, 3) int
        The same triangles, then two for each of the E border edges and each ring.
    """
    sides, opposite = _border(F)
    if not len(sides):
        return V, F
    long = _border_lengths(V, sides) >= min_length
    sides, opposite = sides[long], opposite[long]
    if not len(sides):
        return V, F
    border, index = np.unique(sides, return_inverse=True)
    index = index.reshape(sides.shape)
    outwards = _outwards(V, sides, opposite, index, len(border))
    away = width * np.arange(1, STRIP_RINGS + 1)[:, None, None] / STRIP_RINGS
    rings = len(V) + np.arange(len(border) * STRIP_RINGS).reshape(STRIP_RINGS, -1)
    inner = np.concatenate([border[None], rings[:-1]])
    a, b = (inner[:, index[:, end]].ravel() for end in (0, 1))
    c, d = (rings[:, index[:, end]].ravel() for end in (0, 1))
    strip = np.concatenate([np.stack([b, a, c], axis=1), np.stack([b, c, d], axis=1)])
    moved = (V[border] + away * outwards).reshape(-1, 3)
    return np.concatenate([V, moved]), np.concatenate([F, strip])


def _border(F: IntArray) -> tuple[IntArray, IntArray]:
    """Sides of triangles that have no other one beside them, (E, 2), and the third corners."""
    single = boundary_edges(F)
    if not len(single):
        return single, single[:, 0]
    sides = np.concatenate([F[:, [0, 1]], F[:, [1, 2]], F[:, [2, 0]]]).astype(np.int64)
    opposite = np.concatenate([F[:, 2], F[:, 0], F[:, 1]])
    n = int(F.max()) + 1
    code = sides.min(axis=1) * n + sides.max(axis=1)
    found = np.isin(code, single[:, 0] * n + single[:, 1])
    return sides[found], opposite[found]


def _border_lengths(V: FloatArray, sides: IntArray) -> FloatArray:
    """Length of the border that each side is part of, (E,)."""
    own = graph_components(sides, len(V))[sides[:, 0]]
    total = np.bincount(own, lengths(V[sides[:, 1]] - V[sides[:, 0]])).astype(np.float64)
    return total[own]


def _outwards(
    V: FloatArray, sides: IntArray, opposite: IntArray, index: IntArray, n: int
) -> FloatArray:
    """Directions in which the surface would go on at its n border vertices, (n, 3)."""
    along = V[sides[:, 1]] - V[sides[:, 0]]
    inwards = V[opposite] - V[sides[:, 0]]
    direction = normalized(along)
    inwards = inwards - np.vecdot(inwards, direction)[:, None] * direction
    pull = -normalized(inwards) * lengths(along)[:, None]
    outwards = normalized(sum_at_corners(pull, index, n))
    for _ in range(DIRECTION_SMOOTHING_ROUNDS):
        outwards = normalized(sum_at_corners(outwards[index].sum(axis=1), index, n))
    return outwards
