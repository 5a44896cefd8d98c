"""Loops on intrinsic Delaunay triangles that numba compiles.

Arrays are contiguous, of float64 or int64. Sides of triangles are numbered 3 f + k, side k of
triangle f lying opposite to its corner k.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compile_loop

# Opposite angles may add up to more than 180 degrees by so much, in cotangents.
TOLERANCE = 1e-9
# Flips a triangle, after which a triangulation is good enough; few take more than one.
MOST_FLIPS = 30
# Least surplus of two sides of a triangle over the third, in mean sides.
LEAST_SURPLUS = 1e-5


@compile_loop
def delaunay(F: IntArray, V: FloatArray, twins: IntArray) -> tuple[IntArray, FloatArray]:
    """Flip sides of triangles, on the surface, until their angles allow it no longer.

    `twins` (F, 3) are the sides on the other side of each, -1 on a border. Returns the triangles'
    corners (F, 3), and the lengths of their sides (F, 3).
    """
    F, twins, side = F.copy(), twins.copy(), _side_lengths(F, V)
    n = 3 * len(F)
    waiting, is_waiting = np.empty(n, np.int64), np.zeros(n, np.bool_)
    n_waiting, flips = 0, 0
    for h in range(n - 1, -1, -1):
        if twins[h // 3, h % 3] > h:
            waiting[n_waiting], is_waiting[h] = h, True
            n_waiting += 1
    outer, moved = np.empty(4, np.int64), np.empty(4, np.int64)
    while n_waiting > 0 and flips < MOST_FLIPS * len(F):
        n_waiting -= 1
        h = waiting[n_waiting]
        is_waiting[h] = False
        f, k, t = h // 3, h % 3, twins[h // 3, h % 3]
        g, j = t // 3, t % 3
        if t < 0 or f == g or _cotangent(side, f, k) + _cotangent(side, g, j) >= -TOLERANCE:
            continue
        # Triangles a b c and d c b become a b d and a d c.
        a, b, c, d = F[f, k], F[f, (k + 1) % 3], F[f, (k + 2) % 3], F[g, j]
        outer[0], outer[1] = 3 * g + (j + 1) % 3, 3 * f + (k + 2) % 3
        outer[2], outer[3] = 3 * g + (j + 2) % 3, 3 * f + (k + 1) % 3
        moved[0], moved[1], moved[2], moved[3] = 3 * f, 3 * f + 2, 3 * g, 3 * g + 1
        bd, ab = side[g, (j + 1) % 3], side[f, (k + 2) % 3]
        cd, ac = side[g, (j + 2) % 3], side[f, (k + 1) % 3]
        bc = side[f, k]
        ax, ay = _third_corner(bc, ab, ac)
        dx, dy = _third_corner(bc, bd, cd)
        ad = np.sqrt((ax - dx) ** 2 + (ay + dy) ** 2)
        beyond = (
            twins[g, (j + 1) % 3],
            twins[f, (k + 2) % 3],
            twins[g, (j + 2) % 3],
            twins[f, (k + 1) % 3],
        )
        F[f, 0], F[f, 1], F[f, 2] = a, b, d
        F[g, 0], F[g, 1], F[g, 2] = a, d, c
        side[f, 0], side[f, 1], side[f, 2] = bd, ad, ab
        side[g, 0], side[g, 1], side[g, 2] = cd, ac, ad
        for i in range(4):
            twin = beyond[i]
            # The two may have had other sides in common.
            for other in range(4):
                if twin == outer[other]:
                    twin = moved[other]
                    break
            twins[moved[i] // 3, moved[i] % 3] = twin
            if twin >= 0:
                twins[twin // 3, twin % 3] = moved[i]
        twins[f, 1], twins[g, 2] = 3 * g + 2, 3 * f + 1
        flips += 1
        for i in range(4):
            twin = twins[moved[i] // 3, moved[i] % 3]
            first = min(moved[i], twin)
            if first >= 0 and not is_waiting[first]:
                waiting[n_waiting], is_waiting[first] = first, True
                n_waiting += 1
    return F, side


@compile_loop
def _side_lengths(F: IntArray, V: FloatArray) -> FloatArray:
    """Lengths of sides, all made longer by as much as it takes for triangles to have an area."""
    side = np.empty(F.shape)
    for f in range(len(F)):
        for k in range(3):
            i, j = F[f, (k + 1) % 3], F[f, (k + 2) % 3]
            x, y, z = V[i, 0] - V[j, 0], V[i, 1] - V[j, 1], V[i, 2] - V[j, 2]
            side[f, k] = np.sqrt(x * x + y * y + z * z)
    least, lacking = LEAST_SURPLUS * side.sum() / side.size, 0.0
    for f in range(len(F)):
        for k in range(3):
            surplus = side[f, (k + 1) % 3] + side[f, (k + 2) % 3] - side[f, k]
            lacking = max(lacking, least - surplus)
    return side + lacking


@compile_loop
def _area(a: float, b: float, c: float) -> float:
    """Area of a triangle from its sides, by Kahan's stable form of Heron's formula."""
    if a < b:
        a, b = b, a
    if a < c:
        a, c = c, a
    if b < c:
        b, c = c, b
    square = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c))
    return 0.25 * np.sqrt(max(square, 0.0))


@compile_loop
def _cotangent(side: FloatArray, f: int, k: int) -> float:
    """Cotangent of the angle at a corner of a triangle."""
    a, b, c = side[f, k], side[f, (k + 1) % 3], side[f, (k + 2) % 3]
    return (b * b + c * c - a * a) / max(4.0 * _area(a, b, c), 1e-300)


@compile_loop
def _third_corner(bc: float, ab: float, ac: float) -> tuple[float, float]:
    """Place of a, with b at the origin and c on the first axis."""
    return (bc * bc + ab * ab - ac * ac) / (2.0 * bc), 2.0 * _area(bc, ab, ac) / bc


@compile_loop
def laplacian(
    F: IntArray, side: FloatArray, place: IntArray
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Assemble the permuted Laplacian of intrinsic triangles, entries of a pair not yet added up.

    Returns where columns start (N + 1,), rows and values above the diagonal, the diagonal (N,), and
    lumped areas (N,).
    """
    n = len(place)
    start = np.zeros(n + 1, np.int64)
    for f in range(len(F)):
        for k in range(3):
            i, j = place[F[f, (k + 1) % 3]], place[F[f, (k + 2) % 3]]
            if i != j:
                start[max(i, j) + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    end, rows, values = start[:n].copy(), np.empty(start[n], np.int64), np.empty(start[n])
    diagonal, areas = np.zeros(n), np.zeros(n)
    for f in range(len(F)):
        area = _area(side[f, 0], side[f, 1], side[f, 2])
        for k in range(3):
            areas[place[F[f, k]]] += area / 3.0
            i, j = place[F[f, (k + 1) % 3]], place[F[f, (k + 2) % 3]]
            if i == j:
                continue
            weight, i, j = 0.5 * _cotangent(side, f, k), min(i, j), max(i, j)
            rows[end[j]], values[end[j]] = i, -weight
            end[j] += 1
            diagonal[i] += weight
            diagonal[j] += weight
    return start, rows, values, diagonal, areas


@compile_loop
def descent(F: IntArray, side: FloatArray, place: IntArray, X: FloatArray) -> FloatArray:
    """Divergence of unit vectors along which permuted functions X (N, S) fall, (N, S).

    With l the Laplacian of one triangle, |grad x|^2 is x^T l x over its area, and what flows out
    about its corners is l x / |grad x|.
    """
    out = np.zeros(X.shape)
    for f in range(len(F)):
        i, j, k = place[F[f, 0]], place[F[f, 1]], place[F[f, 2]]
        area = _area(side[f, 0], side[f, 1], side[f, 2])
        at_i = 0.5 * _cotangent(side, f, 0)
        at_j = 0.5 * _cotangent(side, f, 1)
        at_k = 0.5 * _cotangent(side, f, 2)
        for s in range(X.shape[1]):
            jk = at_i * (X[j, s] - X[k, s])
            ki = at_j * (X[k, s] - X[i, s])
            ij = at_k * (X[i, s] - X[j, s])
            energy = X[i, s] * (ij - ki) + X[j, s] * (jk - ij) + X[k, s] * (ki - jk)
            if energy > 0.0:
                inverse = np.sqrt(area / energy)
                out[i, s] -= inverse * (ij - ki)
                out[j, s] -= inverse * (jk - ij)
                out[k, s] -= inverse * (ki - jk)
    return out
