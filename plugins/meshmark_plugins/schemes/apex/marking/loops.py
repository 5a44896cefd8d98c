"""Loops of marking that numba compiles; `meshmark.kernels` decides whether they are used.

Arrays are contiguous, of float64, int64 or bool. The functions of the same names, which the loops
stand in for, say what they do.
"""

from __future__ import annotations

from math import factorial

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, Int32Array, IntArray
from meshmark.kernels import compile_loop
from meshmark.mesh.geometry import TINY
from meshmark.mesh.loops import Point, area_normal, norm

# The series of the sine and of the cosine, the highest power first.
_SINE = tuple((-1.0) ** n / factorial(2 * n + 1) for n in range(7, -1, -1))
_COSINE = tuple((-1.0) ** n / factorial(2 * n) for n in range(7, -1, -1))


@compile_loop
def growth_directions(V: FloatArray, F: IntArray, H: FloatArray) -> FloatArray:
    """Do what the function in `gradients` does."""
    n, n_fields = len(V), len(H)
    directions, about = np.zeros((n_fields, n, 3)), np.zeros(n)
    for f in range(len(F)):
        a, b, c = F[f, 0], F[f, 1], F[f, 2]
        nx, ny, nz = area_normal(V, a, b, c)
        length = norm(nx, ny, nz)
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
            steepness = norm(gx, gy, gz)
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
def carried_changes(
    directions: FloatArray, G: FloatArray, moves: FloatArray, length_scale: float
) -> tuple[FloatArray, FloatArray]:
    """Do what the function in `gradients` does."""
    n_fields, n = len(directions), len(G)
    slopes, change = np.empty((n_fields, n, 3)), np.empty((n_fields, n))
    for m in range(n_fields):
        for v in range(n):
            x, y, z = directions[m, v, 0], directions[m, v, 1], directions[m, v, 2]
            for axis in range(3):
                slope = x * G[v, 0, axis] + y * G[v, 1, axis] + z * G[v, 2, axis]
                slopes[m, v, axis] = slope / length_scale
            along = x * moves[v, 0] + y * moves[v, 1] + z * moves[v, 2]
            change[m, v] = along / length_scale
    return slopes, change


@compile_loop
def sampled_means(
    areas: FloatArray, F: IntArray, H: FloatArray, samples: FloatArray, width: float, n_bins: int
) -> FloatArray:
    """Do what the function in `gradients` does."""
    means = np.zeros((len(H), n_bins))
    total, moment = np.empty(n_bins), np.empty(n_bins)
    for m in range(len(H)):
        total[:] = moment[:] = 0.0
        for f in range(len(F)):
            a, b, c = H[m, F[f, 0]], H[m, F[f, 1]], H[m, F[f, 2]]
            for s in range(len(samples)):
                x = (a * samples[s, 0] + b * samples[s, 1] + c * samples[s, 2]) / width - 1.0
                if 0.0 <= x < n_bins:
                    k = int(x)
                    total[k] += areas[f]
                    moment[k] -= areas[f] * _wave(x - k)[0]
        for k in range(n_bins):
            if total[k] > 0.0:
                means[m, k] = moment[k] / total[k]
    return means


@compile_loop
def chip_rates(
    H: FloatArray,
    slopes: FloatArray,
    start: IntArray,
    corners: IntArray,
    shares: FloatArray,
    weights: FloatArray,
    width: float,
    n_bins: int,
) -> tuple[FloatArray, FloatArray, Int32Array, Int32Array, FloatArray]:
    """Do what the function in `gradients` does."""
    n_fields, n = H.shape
    means, counts = np.zeros((n_fields, n_bins)), np.zeros((n_fields, n_bins))
    starts, filled = np.zeros(n_fields * n_bins + 1, np.int32), 0
    columns, values = np.empty(0, np.int32), np.empty(0)
    total, squares, moment = np.empty(n_bins), np.empty(n_bins), np.empty(n_bins)
    # By the distances of what is displaced.
    rates = np.zeros((n_bins, n))
    for m in range(n_fields):
        total[:] = squares[:] = moment[:] = 0.0
        for v in range(len(weights)):
            distance = 0.0
            for p in range(start[v], start[v + 1]):
                distance += shares[p] * H[m, corners[p]]
            x = distance / width - 1.0
            if not 0.0 <= x < n_bins:
                continue
            k = int(x)
            sine, cosine = _wave(x - k)
            w = weights[v]
            total[k] += w
            squares[k] += w * w
            moment[k] -= w * sine
            # d/du of the kernel -sin(2 pi u), over the bin's width.
            rate = w * (-2.0 * np.pi / width) * cosine
            for p in range(start[v], start[v + 1]):
                rates[k, corners[p]] += rate * shares[p]
        for k in range(n_bins):
            if squares[k] > 0.0:
                means[m, k] = moment[k] / total[k]
                counts[m, k] = total[k] * total[k] / squares[k]
            columns, values = _room(columns, values, filled + 3 * n)
            for v in range(n):
                if rates[k, v] == 0.0:
                    continue
                rate = rates[k, v] / total[k]
                rates[k, v] = 0.0
                for axis in range(3):
                    columns[filled] = 3 * v + axis
                    values[filled] = rate * slopes[m, v, axis]
                    filled += 1
            starts[m * n_bins + k + 1] = filled
    return means, counts, starts, columns[:filled].copy(), values[:filled].copy()


@compile_loop
def _wave(u: float) -> tuple[float, float]:
    """Compute the sine and the cosine of 2 pi u, for u in [0, 1), to 14 digits.

    By their series at a quarter of the angle, in a third of the time that functions for any angle
    take.
    """
    t = 0.5 * np.pi * (u - 0.5)
    q = t * t
    sine, cosine = 0.0, 0.0
    for k in range(len(_SINE)):
        sine = _SINE[k] + q * sine
        cosine = _COSINE[k] + q * cosine
    sine *= t
    sine, cosine = 2.0 * sine * cosine, 1.0 - 2.0 * sine * sine
    return -2.0 * sine * cosine, 2.0 * sine * sine - 1.0


@compile_loop
def _room(columns: Int32Array, values: FloatArray, size: int) -> tuple[Int32Array, FloatArray]:
    """Make room for so many entries of a matrix."""
    have = len(columns)
    if size <= have:
        return columns, values
    more, longer = np.empty(max(size, 2 * have), np.int32), np.empty(max(size, 2 * have))
    more[:have], longer[:have] = columns, values
    return more, longer


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
