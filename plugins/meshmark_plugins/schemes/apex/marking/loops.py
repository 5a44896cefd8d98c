"""Loops of marking that numba compiles; `meshmark.kernels` decides whether they are used.

Arrays are contiguous, of float64, int64 or bool. The functions of the same names, which the loops
stand in for, say what they do.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.kernels import compile_loop
from meshmark.mesh.geometry import TINY
from meshmark.mesh.loops import Point, area_normal, norm


@compile_loop
def both_spreads(V: FloatArray, F: IntArray, edges: IntArray, edge_at: IntArray) -> FloatArray:
    """Do what the function in `sliding` does."""
    n, n_edges = len(V), len(edges)
    sums, about = np.zeros((n, 3, 3)), np.zeros(n)
    outward, share = np.zeros((n_edges, 3)), np.zeros(n_edges)
    for f in range(len(F)):
        nx, ny, nz = area_normal(V, F[f, 0], F[f, 1], F[f, 2])
        length = norm(nx, ny, nz)
        area = 0.5 * length
        size = length if area > TINY else np.inf
        nx, ny, nz = nx / size, ny / size, nz / size
        for k in range(3):
            v, ahead, e = F[f, k], F[f, (k + 1) % 3], edge_at[3 * f + k]
            about[v] += area
            _add_square(sums, v, area, nx, ny, nz)
            x, y, z = V[ahead, 0] - V[v, 0], V[ahead, 1] - V[v, 1], V[ahead, 2] - V[v, 2]
            way = norm(x, y, z)
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
def points_of_triangles(V: FloatArray, F: IntArray, weights: FloatArray) -> FloatArray:
    """Do what the function in `fit_to_surface` does."""
    points = np.empty((len(F), len(weights), 3))
    for f in range(len(F)):
        i, j, k = F[f, 0], F[f, 1], F[f, 2]
        for s in range(len(weights)):
            u, v, w = weights[s, 0], weights[s, 1], weights[s, 2]
            for x in range(3):
                points[f, s, x] = u * V[i, x] + v * V[j, x] + w * V[k, x]
    return points


@compile_loop
def fitted_to_planes(
    V: FloatArray,
    F: IntArray,
    samples: FloatArray,
    V0: FloatArray,
    F0: IntArray,
    face: IntArray,
    damping: float,
    iterations: int,
    tolerance: float,
) -> FloatArray:
    """Do what the function in `fit_to_surface` does."""
    n, n_samples = len(V), len(samples)
    normals, areas, total_area = np.zeros((n, 3)), np.empty(len(F)), 0.0
    for f in range(len(F)):
        normal = area_normal(V, F[f, 0], F[f, 1], F[f, 2])
        areas[f] = 0.5 * norm(*normal)
        total_area += areas[f]
        for k in range(3):
            for x in range(3):
                normals[F[f, k], x] += 0.5 * normal[x]
    for v in range(n):
        normal = _direction(normals[v, 0], normals[v, 1], normals[v, 2])
        normals[v, 0], normals[v, 1], normals[v, 2] = normal
    # What each face adds to the normal equations.
    blocks, b = np.zeros((len(F), 3, 3)), np.zeros(n)
    diagonal = np.zeros(n)
    rate, total = np.empty(3), 0.0
    for f in range(len(F)):
        weight = max(areas[f], 1e-3 * total_area / len(F))
        for s in range(n_samples):
            corner = F0[face[f, s], 0]
            nx, ny, nz = area_normal(V0, corner, F0[face[f, s], 1], F0[face[f, s], 2])
            M = _direction(0.5 * nx, 0.5 * ny, 0.5 * nz)
            off = 0.0
            rate[:] = 0.0
            for x in range(3):
                place = 0.0
                for k in range(3):
                    place += samples[s, k] * V[F[f, k], x]
                    rate[k] += samples[s, k] * normals[F[f, k], x] * M[x]
                off += (V0[corner, x] - place) * M[x]
            for k in range(3):
                b[F[f, k]] += weight * off * rate[k]
                for j in range(3):
                    blocks[f, k, j] += weight * rate[k] * rate[j]
        for k in range(3):
            for j in range(3):
                if F[f, j] == F[f, k]:
                    diagonal[F[f, k]] += blocks[f, k, j]
    for v in range(n):
        total += diagonal[v]
    stay = np.empty(n)
    for v in range(n):
        stay[v] = damping * (diagonal[v] + 1e-3 * total / n)
        diagonal[v] += stay[v]
    # Preconditioned conjugate gradients, from 0.
    offsets, r, z, p, Ap = np.zeros(n), b, np.empty(n), np.zeros(n), np.empty(n)
    before, enough = np.inf, 0.0
    for turn in range(iterations + 1):
        rz = 0.0
        for v in range(n):
            z[v] = r[v] / diagonal[v]
            rz += r[v] * z[v]
        if turn == 0:
            enough = tolerance * tolerance * rz
        if rz <= enough or turn == iterations:
            break
        for v in range(n):
            p[v] = z[v] + rz / before * p[v]
            Ap[v] = stay[v] * p[v]
        for f in range(len(F)):
            i, j, k = F[f, 0], F[f, 1], F[f, 2]
            for corner in range(3):
                row = blocks[f, corner]
                Ap[F[f, corner]] += row[0] * p[i] + row[1] * p[j] + row[2] * p[k]
        curvature = 0.0
        for v in range(n):
            curvature += p[v] * Ap[v]
        for v in range(n):
            offsets[v] += rz / curvature * p[v]
            r[v] -= rz / curvature * Ap[v]
        before = rz
    fitted = np.empty((n, 3))
    for v in range(n):
        for x in range(3):
            fitted[v, x] = V[v, x] + offsets[v] * normals[v, x]
    return fitted


@compile_loop
def _direction(x: float, y: float, z: float) -> Point:
    """Scale a vector to length 1; it stays 0 without any, as in `normalized`."""
    length = norm(x, y, z)
    if not length > TINY:
        return 0.0, 0.0, 0.0
    return x / length, y / length, z / length


@compile_loop
def carried_back(cost: FloatArray, G: FloatArray) -> FloatArray:
    """Do what the function in `energy` does."""
    found = np.empty_like(cost)
    side = np.empty((3, 3))
    for n in range(len(cost)):
        C, A = cost[n], G[n]
        for i in range(3):
            for j in range(3):
                side[i, j] = C[i, 0] * A[0, j] + C[i, 1] * A[1, j] + C[i, 2] * A[2, j]
        for i in range(3):
            for j in range(3):
                found[n, i, j] = A[0, i] * side[0, j] + A[1, i] * side[1, j] + A[2, i] * side[2, j]
    return found


@compile_loop
def tilted_faces(
    V: FloatArray,
    G: FloatArray,
    F: IntArray,
    faces: IntArray,
    moves: FloatArray,
    least_cosine: float,
) -> BoolArray:
    """Do what the function in `fold_smoother` does."""
    tilted, X = np.empty(len(faces), np.bool_), np.empty((3, 3))
    for f in range(len(faces)):
        for k in range(3):
            v = F[faces[f], k]
            x, y, z = moves[v, 0], moves[v, 1], moves[v, 2]
            for i in range(3):
                X[k, i] = V[v, i] + (G[v, i, 0] * x + G[v, i, 1] * y + G[v, i, 2] * z)
        px, py, pz = area_normal(V, F[faces[f], 0], F[faces[f], 1], F[faces[f], 2])
        qx, qy, qz = area_normal(X, 0, 1, 2)
        size = norm(px, py, pz) * norm(qx, qy, qz)
        tilted[f] = px * qx + py * qy + pz * qz < least_cosine * size
    return tilted
