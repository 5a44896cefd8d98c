"""Loops that numba compiles; `meshmark.kernels` decides whether they are used.

Arrays are contiguous, of float64, int64 or bool. The functions of the same names, which the loops
stand in for, say what they do.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.kernels import compile_loop
from meshmark.mesh.geometry import FLAT


@compile_loop
def closest_in_triangle(P: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Do what the function in `meshmark.mesh.closest_points` does."""
    weights = np.empty((len(P), 3))
    for i in range(len(P)):
        ux, uy, uz = b[i, 0] - a[i, 0], b[i, 1] - a[i, 1], b[i, 2] - a[i, 2]
        vx, vy, vz = c[i, 0] - a[i, 0], c[i, 1] - a[i, 1], c[i, 2] - a[i, 2]
        wx, wy, wz = P[i, 0] - a[i, 0], P[i, 1] - a[i, 1], P[i, 2] - a[i, 2]
        uu, uv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz
        vv = vx * vx + vy * vy + vz * vz
        wu, wv = wx * ux + wy * uy + wz * uz, wx * vx + wy * vy + wz * vz
        determinant = uu * vv - uv * uv
        if determinant > FLAT * uu * vv:
            s, t = (vv * wu - uv * wv) / determinant, (uu * wv - uv * wu) / determinant
            if s >= 0.0 and t >= 0.0 and 1.0 - s - t >= 0.0:
                weights[i, 0], weights[i, 1], weights[i, 2] = 1.0 - s - t, s, t
                continue
        # The foot of the perpendicular is outside: the closest point lies on an edge.
        least = np.inf
        for k in range(3):
            if k == 0:
                px, py, pz, ex, ey, ez = wx, wy, wz, ux, uy, uz
            elif k == 1:
                px, py, pz = wx - ux, wy - uy, wz - uz
                ex, ey, ez = vx - ux, vy - uy, vz - uz
            else:
                px, py, pz, ex, ey, ez = wx - vx, wy - vy, wz - vz, -vx, -vy, -vz
            ee = ex * ex + ey * ey + ez * ez
            share = (px * ex + py * ey + pz * ez) / ee if ee > 0.0 else 0.0
            share = min(max(share, 0.0), 1.0)
            dx, dy, dz = px - share * ex, py - share * ey, pz - share * ez
            square = dx * dx + dy * dy + dz * dz
            if square < least:
                least = square
                weights[i, k], weights[i, (k + 1) % 3] = 1.0 - share, share
                weights[i, (k + 2) % 3] = 0.0
    return weights


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
        px, py, pz = area_normal(V, a, b, c)
        qx, qy, qz = area_normal(X, 0, 1, 2)
        size = norm(px, py, pz) * norm(qx, qy, qz)
        if px * qx + py * qy + pz * qz < least_cosine * size:
            offending[a] = offending[b] = offending[c] = True
    return offending


@compile_loop
def area_normal(V: FloatArray, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Compute the normal of a triangle, as long as twice its area."""
    ux, uy, uz = V[b, 0] - V[a, 0], V[b, 1] - V[a, 1], V[b, 2] - V[a, 2]
    vx, vy, vz = V[c, 0] - V[a, 0], V[c, 1] - V[a, 1], V[c, 2] - V[a, 2]
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@compile_loop
def norm(x: float, y: float, z: float) -> float:
    """Compute the length of a vector."""
    return np.sqrt(x * x + y * y + z * z)
