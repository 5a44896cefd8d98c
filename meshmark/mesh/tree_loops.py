"""Loops of the tree in which the closest of many triangles is found."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compile_loop
from meshmark.mesh.geometry import FLAT

# Triangles of a leaf of the tree.
LEAF = 2
# Deeper than any tree of numbered triangles.
MOST_LEVELS = 64


@compile_loop
def tree_order(centres: FloatArray, n_leaves: int) -> IntArray:
    """Order triangles by median splits of their centres (3, F) along the longest sides of boxes."""
    n = centres.shape[1]
    order = np.arange(n)
    starts, sizes = np.empty(MOST_LEVELS, np.int64), np.empty(MOST_LEVELS, np.int64)
    starts[0], sizes[0], n_open = 0, n_leaves, 1
    while n_open > 0:
        n_open -= 1
        start, leaves = starts[n_open], sizes[n_open]
        if leaves == 1:
            continue
        end, middle = min(start + leaves * LEAF, n), start + leaves // 2 * LEAF
        starts[n_open], sizes[n_open] = start, leaves // 2
        starts[n_open + 1], sizes[n_open + 1] = middle, leaves // 2
        n_open += 2
        if middle < end:
            _select(order, centres[_longest_side(centres, order, start, end)], start, middle, end)
    return order


@compile_loop
def _longest_side(centres: FloatArray, order: IntArray, start: int, end: int) -> int:
    axis, longest = 0, -1.0
    for x in range(3):
        low, high = np.inf, -np.inf
        for i in range(start, end):
            value = centres[x, order[i]]
            low, high = min(low, value), max(high, value)
        if high - low > longest:
            axis, longest = x, high - low
    return axis


@compile_loop
def _select(order: IntArray, values: FloatArray, start: int, middle: int, end: int) -> None:
    """Order what lies between start and end so that none before the middle is greater (Hoare)."""
    left, right = start, end - 1
    while left < right:
        pivot = values[order[(left + right) // 2]]
        i, j = left, right
        while i <= j:
            while values[order[i]] < pivot:
                i += 1
            while values[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


@compile_loop
def tree_boxes(corners: FloatArray, n_leaves: int) -> FloatArray:
    """Bound the nodes of a tree of triangles (F, 9), (2 n_leaves, 6); i has 2 i and 2 i + 1."""
    n = len(corners)
    boxes = np.empty((2 * n_leaves, 6))
    for leaf in range(n_leaves):
        for x in range(3):
            low, high = np.inf, -np.inf
            for f in range(leaf * LEAF, min((leaf + 1) * LEAF, n)):
                for corner in range(3):
                    value = corners[f, 3 * corner + x]
                    low, high = min(low, value), max(high, value)
            boxes[n_leaves + leaf, x], boxes[n_leaves + leaf, 3 + x] = low, high
    for node in range(n_leaves - 1, 0, -1):
        for x in range(3):
            boxes[node, x] = min(boxes[2 * node, x], boxes[2 * node + 1, x])
            boxes[node, 3 + x] = max(boxes[2 * node, 3 + x], boxes[2 * node + 1, 3 + x])
    return boxes


@compile_loop
def closest_triangles(
    corners: FloatArray, boxes: FloatArray, order: IntArray, Q: FloatArray
) -> IntArray:
    """Find the triangle closest to each query (n, 3), the first of several, (n,)."""
    n, n_leaves = len(corners), len(boxes) // 2
    found = np.empty(len(Q), np.int64)
    nodes, squares = np.empty(MOST_LEVELS, np.int64), np.empty(MOST_LEVELS)
    nearest = 0
    for i in range(len(Q)):
        x, y, z = Q[i, 0], Q[i, 1], Q[i, 2]
        # Queries that follow each other are mostly neighbours.
        least = _square_to_triangle(corners, nearest, x, y, z)
        nodes[0], squares[0], n_open = 1, 0.0, 1
        while n_open > 0:
            n_open -= 1
            node = nodes[n_open]
            if squares[n_open] > least:
                continue
            while node < n_leaves:
                left, right = 2 * node, 2 * node + 1
                to_left = _square_to_box(boxes, left, x, y, z)
                to_right = _square_to_box(boxes, right, x, y, z)
                if to_left > to_right:
                    left, right, to_left, to_right = right, left, to_right, to_left
                # Without a branch: which way it goes is mostly anybody's guess.
                nodes[n_open], squares[n_open] = right, to_right
                n_open += 1 if to_right <= least else 0
                if to_left > least:
                    break
                node = left
            if node < n_leaves:
                continue
            first = (node - n_leaves) * LEAF
            for f in range(first, min(first + LEAF, n)):
                square = _square_to_triangle(corners, f, x, y, z)
                if square < least or (square == least and order[f] < order[nearest]):
                    least, nearest = square, f
        found[i] = order[nearest]
    return found


@compile_loop
def _square_to_box(boxes: FloatArray, node: int, x: float, y: float, z: float) -> float:
    dx = max(boxes[node, 0] - x, x - boxes[node, 3], 0.0)
    dy = max(boxes[node, 1] - y, y - boxes[node, 4], 0.0)
    dz = max(boxes[node, 2] - z, z - boxes[node, 5], 0.0)
    return dx * dx + dy * dy + dz * dz


@compile_loop
def _square_to_triangle(corners: FloatArray, f: int, x: float, y: float, z: float) -> float:
    """Squared distance from triangle f; see `closest_in_triangle`."""
    ax, ay, az = corners[f, 0], corners[f, 1], corners[f, 2]
    ux, uy, uz = corners[f, 3] - ax, corners[f, 4] - ay, corners[f, 5] - az
    vx, vy, vz = corners[f, 6] - ax, corners[f, 7] - ay, corners[f, 8] - az
    wx, wy, wz = x - ax, y - ay, z - az
    uu, uv, vv = (
        ux * ux + uy * uy + uz * uz,
        ux * vx + uy * vy + uz * vz,
        vx * vx + vy * vy + vz * vz,
    )
    wu, wv = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
    determinant = uu * vv - uv * uv
    flat = determinant <= FLAT * uu * vv
    s, t = vv * wu - uv * wv, uu * wv - uv * wu
    if not flat and s >= 0.0 and t >= 0.0 and s + t <= determinant:
        s, t = s / determinant, t / determinant
        dx, dy, dz = wx - s * ux - t * vx, wy - s * uy - t * vy, wz - s * uz - t * vz
        return dx * dx + dy * dy + dz * dz
    # The way to the triangle leads through a side that parts it from the point.
    least = np.inf
    if flat or t < 0.0:
        least = _square_to_segment(wx, wy, wz, ux, uy, uz)
    if flat or s < 0.0:
        least = min(least, _square_to_segment(wx, wy, wz, vx, vy, vz))
    if flat or s + t > determinant:
        square = _square_to_segment(wx - ux, wy - uy, wz - uz, vx - ux, vy - uy, vz - uz)
        least = min(least, square)
    return least


@compile_loop
def _square_to_segment(wx: float, wy: float, wz: float, ux: float, uy: float, uz: float) -> float:
    """Squared distance of w from the segment from 0 to u."""
    uu, wu = ux * ux + uy * uy + uz * uz, wx * ux + wy * uy + wz * uz
    share = min(max(wu / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    dx, dy, dz = wx - share * ux, wy - share * uy, wz - share * uz
    return dx * dx + dy * dy + dz * dz
