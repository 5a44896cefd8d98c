"""Loops that numba compiles; `meshmark.kernels` decides whether they are used.

Arrays are contiguous, of float64, int64 or bool. The functions of the same names, which the loops
stand in for, say what they do.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.kernels import compile_loop
from meshmark.mesh.flip_guard import HALVINGS, NO_SLOPE
from meshmark.mesh.geometry import FLAT, TINY

Point: TypeAlias = tuple[float, float, float]


@compile_loop
def area_vectors(V: FloatArray, F: IntArray) -> FloatArray:
    """Do what the function in `meshmark.mesh.geometry` does."""
    N = np.empty((len(F), 3))
    for f in range(len(F)):
        x, y, z = area_normal(V, F[f, 0], F[f, 1], F[f, 2])
        N[f, 0], N[f, 1], N[f, 2] = 0.5 * x, 0.5 * y, 0.5 * z
    return N


@compile_loop
def face_areas(V: FloatArray, F: IntArray) -> FloatArray:
    """Do what the function in `meshmark.mesh.geometry` does."""
    areas = np.empty(len(F))
    for f in range(len(F)):
        x, y, z = area_normal(V, F[f, 0], F[f, 1], F[f, 2])
        areas[f] = norm(0.5 * x, 0.5 * y, 0.5 * z)
    return areas


@compile_loop
def vertex_normals(V: FloatArray, F: IntArray) -> FloatArray:
    """Do what the function in `meshmark.mesh.geometry` does."""
    normals = np.zeros((len(V), 3))
    for f in range(len(F)):
        x, y, z = area_normal(V, F[f, 0], F[f, 1], F[f, 2])
        for corner in range(3):
            v = F[f, corner]
            normals[v, 0] += 0.5 * x
            normals[v, 1] += 0.5 * y
            normals[v, 2] += 0.5 * z
    for v in range(len(V)):
        length = norm(normals[v, 0], normals[v, 1], normals[v, 2])
        for axis in range(3):
            normals[v, axis] = normals[v, axis] / length if length > TINY else 0.0
    return normals


@compile_loop
def closest_in_triangle(P: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Do what the function in `meshmark.mesh.closest_in_triangle` does."""
    weights = np.empty((len(P), 3))
    for i in range(len(P)):
        u = b[i, 0] - a[i, 0], b[i, 1] - a[i, 1], b[i, 2] - a[i, 2]
        v = c[i, 0] - a[i, 0], c[i, 1] - a[i, 1], c[i, 2] - a[i, 2]
        w = P[i, 0] - a[i, 0], P[i, 1] - a[i, 1], P[i, 2] - a[i, 2]
        weights[i, 0], weights[i, 1], weights[i, 2], _ = closest_weights(w, u, v)
    return weights


@compile_loop
def closest_weights(w: Point, u: Point, v: Point) -> tuple[float, float, float, float]:
    """Weights of 0, u and v in the point of their triangle closest to w, and its square from w."""
    uu, uv, vv, wu, wv = dot(u, u), dot(u, v), dot(v, v), dot(w, u), dot(w, v)
    determinant = uu * vv - uv * uv
    flat = not determinant > FLAT * uu * vv
    s, t = (vv * wu - uv * wv) / determinant, (uu * wv - uv * wu) / determinant
    r = 1.0 - s - t
    if not flat and r >= 0.0 and s >= 0.0 and t >= 0.0:
        d = w[0] - s * u[0] - t * v[0], w[1] - s * u[1] - t * v[1], w[2] - s * u[2] - t * v[2]
        return r, s, t, dot(d, d)
    # The way to the triangle leads through a side that parts it from the point.
    least, best = np.inf, (1.0, 0.0, 0.0)
    if flat or t < 0.0:
        share, square = _closest_share(w, u)
        if square < least:
            least, best = square, (1.0 - share, share, 0.0)
    if flat or r < 0.0:
        to_u = w[0] - u[0], w[1] - u[1], w[2] - u[2]
        share, square = _closest_share(to_u, (v[0] - u[0], v[1] - u[1], v[2] - u[2]))
        if square < least:
            least, best = square, (0.0, 1.0 - share, share)
    if flat or s < 0.0:
        to_v = w[0] - v[0], w[1] - v[1], w[2] - v[2]
        share, square = _closest_share(to_v, (-v[0], -v[1], -v[2]))
        if square < least:
            least, best = square, (share, 0.0, 1.0 - share)
    return best[0], best[1], best[2], least


@compile_loop
def _closest_share(w: Point, u: Point) -> tuple[float, float]:
    """Part of the way from 0 to u that is closest to w, and the square of its distance."""
    uu = dot(u, u)
    share = min(max(dot(w, u) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    d = w[0] - share * u[0], w[1] - share * u[1], w[2] - share * u[2]
    return share, dot(d, d)


@compile_loop
def walked(
    V: FloatArray,
    F: IntArray,
    start: IntArray,
    about: IntArray,
    border: BoolArray,
    Q: FloatArray,
    near: IntArray,
    tolerance: FloatArray,
) -> IntArray:
    """Do what the function in `meshmark.mesh.surface_walk` does."""
    found = near.copy()
    for i in range(len(Q)):
        face = found[i]
        least, first, second = _look(V, F, face, Q, i)
        while first >= 0:
            nearest, square, one, two = face, least, -1, -1
            for h in range(start[first], start[first + 1]):
                f = about[h]
                if f == face or not (second < 0 or second in (F[f, 0], F[f, 1], F[f, 2])):
                    continue
                there, a, b = _look(V, F, f, Q, i)
                if there < square:
                    nearest, square, one, two = f, there, a, b
            if nearest == face:
                break
            face, least, first, second = nearest, square, one, two
        ends = first >= 0 and border[first] and (second < 0 or border[second])
        found[i] = -1 if ends or least > tolerance[i] ** 2 else face
    return found


@compile_loop
def _look(V: FloatArray, F: IntArray, f: int, Q: FloatArray, i: int) -> tuple[float, int, int]:
    """Square of a query's distance from a triangle, and the ends of the side it is closest to.

    Of a corner that it is closest to, and -1; or twice -1 inside.
    """
    a, b, c = F[f, 0], F[f, 1], F[f, 2]
    w = Q[i, 0] - V[a, 0], Q[i, 1] - V[a, 1], Q[i, 2] - V[a, 2]
    u = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
    v = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
    r, s, t, square = closest_weights(w, u, v)
    if r > 0.0 and s > 0.0 and t > 0.0:
        return square, -1, -1
    if r > 0.0:
        return square, a, b if s > 0.0 else c if t > 0.0 else -1
    if s > 0.0:
        return square, b, c if t > 0.0 else -1
    return square, c, -1


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
        area = norm(nx, ny, nz)
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
def shares_without_tilt(
    V: FloatArray,
    moved: FloatArray,
    F: IntArray,
    start: IntArray,
    about: IntArray,
    share: FloatArray,
    least_cosine: float,
    ramp: float,
) -> FloatArray:
    """Do what the function in `meshmark.mesh.flip_guard` does."""
    n = len(start) - 1
    share, length = share.copy(), np.empty(n)
    for v in range(n):
        length[v] = norm(moved[v, 0] - V[v, 0], moved[v, 1] - V[v, 1], moved[v, 2] - V[v, 2])
    # A vertex is listed once: `turn_of` tells in which turn it offended last, or changed.
    offending, offended = np.empty(n, np.int64), np.full(n, -1)
    changed, turn_of = np.empty(n, np.int64), np.full(n, -1)
    queue, waits = np.empty(n, np.int64), np.zeros(n, np.bool_)
    n_changed, turn = 0, 0
    while True:
        n_offending = 0
        if turn == 0:
            for f in range(len(F)):
                if _tilts(V, moved, F, f, share, length, least_cosine):
                    n_offending = _list_corners(F, f, turn, offended, offending, n_offending)
        for i in range(n_changed):
            for h in range(start[changed[i]], start[changed[i] + 1]):
                if _tilts(V, moved, F, about[h], share, length, least_cosine):
                    f = about[h]
                    n_offending = _list_corners(F, f, turn, offended, offending, n_offending)
        if n_offending == 0:
            return share
        n_changed, n_waiting = 0, 0
        if turn == 0:
            # Those that go but a part of their way from the start hold their neighbours back, too.
            for v in range(n):
                if share[v] < 1.0 and offended[v] < turn:
                    queue[n_waiting], waits[v] = v, True
                    n_waiting += 1
        for i in range(n_offending):
            v = offending[i]
            lower = 0.5 * share[v] if turn < HALVINGS else 0.0
            if lower < share[v]:
                share[v], turn_of[v], changed[n_changed] = lower, turn, v
                n_changed += 1
            queue[n_waiting], waits[v] = v, True
            n_waiting += 1
        first = 0
        while ramp > 0.0 and n_waiting > 0:
            v = queue[first]
            first, n_waiting, waits[v] = (first + 1) % n, n_waiting - 1, False
            for h in range(start[v], start[v + 1]):
                for k in range(3):
                    u = F[about[h], k]
                    way = ramp * max(length[u], length[v])
                    side = norm(V[u, 0] - V[v, 0], V[u, 1] - V[v, 1], V[u, 2] - V[v, 2])
                    if u == v or not side < way:
                        continue
                    most = max(share[v], NO_SLOPE) + max(side / way, NO_SLOPE)
                    if most >= share[u]:
                        continue
                    share[u] = most
                    if turn_of[u] < turn:
                        turn_of[u], changed[n_changed] = turn, u
                        n_changed += 1
                    if not waits[u]:
                        queue[(first + n_waiting) % n], waits[u] = u, True
                        n_waiting += 1
        turn += 1


@compile_loop
def _tilts(
    V: FloatArray,
    moved: FloatArray,
    F: IntArray,
    f: int,
    share: FloatArray,
    length: FloatArray,
    least_cosine: float,
) -> bool:
    """Tell whether a face tilts too far if its corners go these shares of their ways."""
    a, b, c = F[f, 0], F[f, 1], F[f, 2]
    if not share[a] * length[a] + share[b] * length[b] + share[c] * length[c] > 0.0:
        return False
    px, py, pz = area_normal(V, a, b, c)
    ax, ay, az = _part_of_way(V, moved, a, share[a])
    bx, by, bz = _part_of_way(V, moved, b, share[b])
    cx, cy, cz = _part_of_way(V, moved, c, share[c])
    qx, qy, qz = cross(bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az)
    size = norm(px, py, pz) * norm(qx, qy, qz)
    return px * qx + py * qy + pz * qz < least_cosine * size


@compile_loop
def _part_of_way(V: FloatArray, moved: FloatArray, v: int, share: float) -> Point:
    return (
        V[v, 0] + share * (moved[v, 0] - V[v, 0]),
        V[v, 1] + share * (moved[v, 1] - V[v, 1]),
        V[v, 2] + share * (moved[v, 2] - V[v, 2]),
    )


@compile_loop
def _list_corners(
    F: IntArray, f: int, turn: int, listed: IntArray, corners: IntArray, count: int
) -> int:
    """List the corners of a face that were not listed in this turn; return how many there are."""
    for k in range(3):
        v = F[f, k]
        if listed[v] < turn:
            listed[v], corners[count] = turn, v
            count += 1
    return count


@compile_loop
def area_normal(V: FloatArray, a: int, b: int, c: int) -> Point:
    """Compute the normal of a triangle, as long as twice its area."""
    ux, uy, uz = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
    vx, vy, vz = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
    return cross(ux, uy, uz, vx, vy, vz)


@compile_loop
def cross(ux: float, uy: float, uz: float, vx: float, vy: float, vz: float) -> Point:
    """Compute the cross product u x v."""
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@compile_loop
def dot(u: Point, v: Point) -> float:
    """Compute the scalar product of two vectors."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@compile_loop
def norm(x: float, y: float, z: float) -> float:
    """Compute the length of a vector."""
    return np.sqrt(x * x + y * y + z * z)
