"""Loops of chips that numba compiles; `meshmark.kernels` decides whether they are used.

Arrays are contiguous, of float64, int64 or bool. The functions of the same names, which the loops
stand in for, say what they do.
"""

from __future__ import annotations

from math import factorial

import numpy as np

from meshmark.arrays import FloatArray, Int32Array, IntArray
from meshmark.kernels import compile_loop
from meshmark.mesh.geometry import TINY
from meshmark.mesh.loops import area_normal, norm

# The series of the sine and of the cosine, the highest power first.
_SINE = tuple((-1.0) ** n / factorial(2 * n + 1) for n in range(7, -1, -1))
_COSINE = tuple((-1.0) ** n / factorial(2 * n) for n in range(7, -1, -1))


@compile_loop
def spread_masses_by_rows(
    areas: FloatArray,
    F: IntArray,
    weights: FloatArray,
    length: float,
    masses: FloatArray,
    iterations: int,
    tolerance: float,
) -> FloatArray:
    """Do what the function in `whitening` does."""
    n = len(areas)
    start, columns, values, diagonal = _rows_of_sides(F, length * length * weights, n)
    for v in range(n):
        diagonal[v] += areas[v]
    # Preconditioned conjugate gradients.
    x, r = np.full(n, masses.sum()), np.empty(n)
    p, Ap = np.zeros(n), np.empty(n)
    for v in range(n):
        r[v] = diagonal[v] * x[v]
        for e in range(start[v], start[v + 1]):
            r[v] -= values[e] * x[columns[e]]
        r[v] = masses[v] - r[v]
    before, enough = np.inf, 0.0
    for turn in range(iterations + 1):
        rz = 0.0
        for v in range(n):
            rz += r[v] * r[v] / diagonal[v]
        if turn == 0:
            enough = tolerance * tolerance * rz
        if rz <= enough or turn == iterations:
            break
        for v in range(n):
            p[v] = r[v] / diagonal[v] + rz / before * p[v]
        curvature = 0.0
        for v in range(n):
            total = diagonal[v] * p[v]
            for e in range(start[v], start[v + 1]):
                total -= values[e] * p[columns[e]]
            Ap[v] = total
            curvature += p[v] * total
        for v in range(n):
            x[v] += rz / curvature * p[v]
            r[v] -= rz / curvature * Ap[v]
        before = rz
    return x


@compile_loop
def _rows_of_sides(
    F: IntArray, weights: FloatArray, n: int
) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Sum the weights of the sides opposite to corners, by the vertices that sides join.

    Returns
    -------
    start, columns, values
        The rows of a symmetric matrix.
    sums : (n,) float64
        Of each row.
    """
    room = np.zeros(n + 1, np.int64)
    for f in range(len(F)):
        for k in range(3):
            room[F[f, k] + 1] += 2
    room = np.cumsum(room)
    filled, columns, values = room[:-1].copy(), np.empty(room[n], np.int64), np.empty(room[n])
    sums = np.zeros(n)
    for f in range(len(F)):
        for k in range(3):
            w, i, j = weights[f, k], F[f, (k + 1) % 3], F[f, (k + 2) % 3]
            if i == j:
                continue
            for here, there in ((i, j), (j, i)):
                sums[here] += w
                at = room[here]
                while at < filled[here] and columns[at] != there:
                    at += 1
                if at == filled[here]:
                    columns[at], values[at] = there, 0.0
                    filled[here] += 1
                values[at] += w
    start, to = np.zeros(n + 1, np.int64), 0
    for v in range(n):
        for at in range(room[v], filled[v]):
            columns[to], values[to] = columns[at], values[at]
            to += 1
        start[v + 1] = to
    return start, columns, values, sums


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
