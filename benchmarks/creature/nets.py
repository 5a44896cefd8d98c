"""Quads from a sampled field: dual marching cubes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray

_MAX_PATCHES = 4


def dual_quads(value: FloatArray) -> tuple[FloatArray, IntArray]:
    """Polygonise the zero set of a field sampled on a grid.

    Every connected patch of the zero set inside a cell gives a vertex, every grid edge that
    crosses it a quad of the four patches about that edge.

    Parameters
    ----------
    value : (I, J, K) float64
        Field at the grid's corners, negative inside; no sign change on the outermost layer.

    Returns
    -------
    V : (N, 3) float64
        Vertex positions in grid units: the mean of each patch's edge crossings.
    Q : (P, 4) int
        Quads, counter-clockwise seen from outside.

    Notes
    -----
    One vertex a cell (surface nets) pinches where two sheets run through one cell; one a patch
    does so only where two ambiguous cells meet face to face [1]_.

    References
    ----------
    .. [1] G. M. Nielson, "Dual marching cubes", IEEE Visualization 2004,
       https://doi.org/10.1109/VISUAL.2004.28
    """
    inside = value < 0
    cells = tuple(n - 1 for n in value.shape)
    patch_of = patch_table()[_configuration(inside)]
    crossings, patches = [], []
    for axis in range(3):
        first, second = _ends(axis)
        where = np.argwhere(inside[first] != inside[second])
        at, beyond = value[first][tuple(where.T)], value[second][tuple(where.T)]
        crossing = where.astype(np.float64)
        crossing[:, axis] += at / (at - beyond)
        around = []
        # The four cells about an edge, counter-clockwise seen from the edge's far end; the edge
        # lies on the far side of a cell that was reached by a step back.
        for back_u, back_v in ((1, 1), (0, 1), (0, 0), (1, 0)):
            cell = where.copy()
            cell[:, (axis + 1) % 3] -= back_u
            cell[:, (axis + 2) % 3] -= back_v
            patch = patch_of[(*cell.T, _edge(axis, back_u, back_v))]
            around.append(np.ravel_multi_index(tuple(cell.T), cells) * _MAX_PATCHES + patch)
        quad = np.stack(around, axis=1)
        # Outward is along the axis where the edge leaves the inside.
        patches.append(np.where(at[:, None] < 0, quad, quad[:, ::-1]))
        crossings.append(crossing)

    corners = np.concatenate(patches)
    used, Q = np.unique(corners, return_inverse=True)
    Q = Q.reshape(-1, 4).astype(np.int64)
    points = np.repeat(np.concatenate(crossings), 4, axis=0)
    count = np.bincount(Q.reshape(-1), minlength=len(used))
    sums = [np.bincount(Q.reshape(-1), weights=column) for column in points.T]
    return np.stack(sums, axis=1) / count[:, None], Q


def _ends(axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Slice the two ends of every grid edge along an axis."""
    first = tuple(slice(None, -1) if i == axis else slice(None) for i in range(3))
    second = tuple(slice(1, None) if i == axis else slice(None) for i in range(3))
    return first, second


def _configuration(inside: NDArray[np.bool_]) -> IntArray:
    """Encode which corners of each cell are inside; corner (x, y, z) is bit x + 2 y + 4 z."""
    code = np.zeros(tuple(n - 1 for n in inside.shape), dtype=np.int64)
    for bit in range(8):
        corner = tuple(slice(1, None) if bit >> i & 1 else slice(None, -1) for i in range(3))
        code += inside[corner].astype(np.int64) << bit
    return code


def _edge(axis: int, far_u: int, far_v: int) -> int:
    """Index a cell's edge by its axis and its side along the two axes that follow."""
    return 4 * axis + far_u + 2 * far_v


def patch_table() -> IntArray:
    """List, for each of the 256 cells, the patch each of its 12 edges belongs to.

    Returns
    -------
    (256, 12) int
        Patch number, from 0; -1 for an edge without a crossing. On an ambiguous face the two
        inside corners are kept apart, which both cells of the face decide alike.
    """
    faces = [_face(axis, side) for axis in range(3) for side in (0, 1)]
    table = np.full((256, 12), -1, dtype=np.int64)
    for code in range(256):
        links = np.eye(12, dtype=bool)
        crossed = np.zeros(12, dtype=bool)
        for corners, edges in faces:
            inside = [bool(code >> corner & 1) for corner in corners]
            cut = [edges[i] for i in range(4) if inside[i] != inside[(i + 1) % 4]]
            crossed[cut] = True
            if len(cut) == 2:
                links[cut[0], cut[1]] = links[cut[1], cut[0]] = True
            elif len(cut) == 4:
                for i in (i for i in range(4) if inside[i]):
                    links[edges[i], edges[i - 1]] = links[edges[i - 1], edges[i]] = True
        # Twelve edges: four squarings close any chain.
        for _ in range(4):
            links = links @ links
        lowest = links.argmax(axis=1)
        table[code, crossed] = np.unique(lowest[crossed], return_inverse=True)[1].reshape(-1)
    return table


def _face(axis: int, side: int) -> tuple[list[int], list[int]]:
    """List a cell face's corners in a ring, and its edges: edge i joins corners i and i + 1."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    ring = ((0, 0), (1, 0), (1, 1), (0, 1))
    corners = [(side << axis) + (p << u) + (q << v) for p, q in ring]
    # An edge along u has axis u, then v and `axis` follow it; one along v has `axis` and u.
    edges = [_edge(u, 0, side), _edge(v, side, 1), _edge(u, 1, side), _edge(v, side, 0)]
    return corners, edges
