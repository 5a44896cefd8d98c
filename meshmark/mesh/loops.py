"""Loops that numba compiles; `meshmark.kernels` decides whether they are used.

Arrays are contiguous, of float64, int64 or bool. The functions of the same names, which the loops
stand in for, say what they do.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.kernels import compile_loop
from meshmark.mesh.geometry import FLAT, TINY

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
                if to_right <= least:
                    nodes[n_open], squares[n_open] = right, to_right
                    n_open += 1
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


@compile_loop
def fitted_gradients(
    V: FloatArray,
    start: IntArray,
    neighbours: IntArray,
    share: FloatArray,
    axes: FloatArray,
    known: BoolArray,
) -> FloatArray:
    """Do what the function in `meshmark.mesh.deformation` does."""
    n = len(start) - 1
    G = np.empty((n, 3, 3))
    image = np.empty((3, 3))
    for v in range(n):
        for x in range(3):
            first, second = 0.0, 0.0
            for h in range(start[v], start[v + 1]):
                edge = V[neighbours[h], x] - V[v, x]
                first += edge * share[h, 0]
                second += edge * share[h, 1]
            image[0, x] = first if known[v, 0] else axes[v, x, 0]
            image[1, x] = second if known[v, 1] else axes[v, x, 1]
        ux, uy, uz = image[0, 0], image[0, 1], image[0, 2]
        vx, vy, vz = image[1, 0], image[1, 1], image[1, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = _length(nx, ny, nz)
        size = np.sqrt(area) if area > 0.0 else 1.0
        image[2, 0], image[2, 1], image[2, 2] = nx / size, ny / size, nz / size
        for x in range(3):
            for y in range(3):
                G[v, x, y] = (
                    image[0, x] * axes[v, y, 0]
                    + image[1, x] * axes[v, y, 1]
                    + image[2, x] * axes[v, y, 2]
                )
    return G


@compile_loop
def tilted_corners(
    V: FloatArray,
    moved: FloatArray,
    F: IntArray,
    share: FloatArray,
    changed: BoolArray,
    least_cosine: float,
) -> BoolArray:
    """Do what the function in `meshmark.mesh.flip_guard` does."""
    n = len(V)
    moves, offending = np.zeros(n, np.bool_), np.zeros(n, np.bool_)
    for v in range(n):
        moves[v] = share[v] > 0.0 and (
            V[v, 0] != moved[v, 0] or V[v, 1] != moved[v, 1] or V[v, 2] != moved[v, 2]
        )
    X = np.empty((3, 3))
    for f in range(len(F)):
        a, b, c = F[f, 0], F[f, 1], F[f, 2]
        if not (changed[a] or changed[b] or changed[c]):
            continue
        if not (moves[a] or moves[b] or moves[c]):
            continue
        for k in range(3):
            v = F[f, k]
            for x in range(3):
                X[k, x] = V[v, x] + share[v] * (moved[v, x] - V[v, x])
        px, py, pz = _normal(V, a, b, c)
        qx, qy, qz = _normal(X, 0, 1, 2)
        size = _length(px, py, pz) * _length(qx, qy, qz)
        if px * qx + py * qy + pz * qz < least_cosine * size:
            offending[a] = offending[b] = offending[c] = True
    return offending


@compile_loop
def growth_directions(V: FloatArray, F: IntArray, H: FloatArray) -> FloatArray:
    """Do what the function in the gradients of `apex` does."""
    n, n_fields = len(V), len(H)
    directions, about = np.zeros((n_fields, n, 3)), np.zeros(n)
    for f in range(len(F)):
        a, b, c = F[f, 0], F[f, 1], F[f, 2]
        nx, ny, nz = _normal(V, a, b, c)
        length = _length(nx, ny, nz)
        area = 0.5 * length
        for corner in (a, b, c):
            about[corner] += area
        # `normalized` knows no direction of anything as short as this.
        if not area > TINY:
            continue
        nx, ny, nz = nx / length, ny / length, nz / length
        for m in range(n_fields):
            # The gradient of a linear function, times an area: n x sum of its values times sides.
            ha, hb, hc = H[m, a], H[m, b], H[m, c]
            ex = ha * (V[c, 0] - V[b, 0]) + hb * (V[a, 0] - V[c, 0]) + hc * (V[b, 0] - V[a, 0])
            ey = ha * (V[c, 1] - V[b, 1]) + hb * (V[a, 1] - V[c, 1]) + hc * (V[b, 1] - V[a, 1])
            ez = ha * (V[c, 2] - V[b, 2]) + hb * (V[a, 2] - V[c, 2]) + hc * (V[b, 2] - V[a, 2])
            gx, gy, gz = ny * ez - nz * ey, nz * ex - nx * ez, nx * ey - ny * ex
            steepness = _length(gx, gy, gz)
            if not steepness > TINY:
                continue
            share = area / steepness
            for corner in (a, b, c):
                directions[m, corner, 0] += share * gx
                directions[m, corner, 1] += share * gy
                directions[m, corner, 2] += share * gz
    for m in range(n_fields):
        for v in range(n):
            for x in range(3):
                directions[m, v, x] /= max(about[v], 1e-300)
    return directions


@compile_loop
def both_spreads(V: FloatArray, F: IntArray, edges: IntArray, edge_at: IntArray) -> FloatArray:
    """Do what the function for the cost of sliding of `apex` does."""
    n, n_edges = len(V), len(edges)
    sums, about = np.zeros((n, 3, 3)), np.zeros(n)
    outward, share = np.zeros((n_edges, 3)), np.zeros(n_edges)
    for f in range(len(F)):
        nx, ny, nz = _normal(V, F[f, 0], F[f, 1], F[f, 2])
        length = _length(nx, ny, nz)
        area = 0.5 * length
        size = length if area > TINY else np.inf
        nx, ny, nz = nx / size, ny / size, nz / size
        for k in range(3):
            v, ahead, e = F[f, k], F[f, (k + 1) % 3], edge_at[3 * f + k]
            about[v] += area
            _add_square(sums, v, area, nx, ny, nz)
            x, y, z = V[ahead, 0] - V[v, 0], V[ahead, 1] - V[v, 1], V[ahead, 2] - V[v, 2]
            way = _length(x, y, z)
            way = way if way > TINY else np.inf
            x, y, z = x / way, y / way, z / way
            outward[e, 0] += y * nz - z * ny
            outward[e, 1] += z * nx - x * nz
            outward[e, 2] += x * ny - y * nx
            # A third of a triangle's area belongs to each of its edges.
            share[e] += area / 3.0
    for e in range(n_edges):
        for k in range(2):
            v = edges[e, k]
            _add_square(sums, v, share[e], outward[e, 0], outward[e, 1], outward[e, 2])
    for v in range(n):
        for x in range(3):
            for y in range(3):
                sums[v, x, y] /= max(about[v], 1e-300)
    return sums


@compile_loop
def _add_square(sums: FloatArray, v: int, weight: float, x: float, y: float, z: float) -> None:
    """Add the weighted outer product of a vector with itself to the sum of a vertex."""
    sums[v, 0, 0] += weight * x * x
    sums[v, 0, 1] += weight * x * y
    sums[v, 0, 2] += weight * x * z
    sums[v, 1, 0] += weight * y * x
    sums[v, 1, 1] += weight * y * y
    sums[v, 1, 2] += weight * y * z
    sums[v, 2, 0] += weight * z * x
    sums[v, 2, 1] += weight * z * y
    sums[v, 2, 2] += weight * z * z


@compile_loop
def _normal(V: FloatArray, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Compute the normal of a triangle, as long as twice its area."""
    ux, uy, uz = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
    vx, vy, vz = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@compile_loop
def _length(x: float, y: float, z: float) -> float:
    return np.sqrt(x * x + y * y + z * z)
