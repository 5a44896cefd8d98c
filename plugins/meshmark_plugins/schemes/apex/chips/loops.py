"""Loops of chips that numba compiles; `meshmark.kernels` decides whether they are used.

Arrays are contiguous, of float64, int64 or bool. The functions of the same names, which the loops
stand in for, say what they do.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compile_loop


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
