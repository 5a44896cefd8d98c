"""Loops of linear algebra that numba compiles; `meshmark.kernels` decides whether they are used.

Arrays are contiguous, of float64 or int64. The functions of the same names, which the loops stand
in for, say what they do.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compile_loop


@compile_loop
def row_products(
    starts: IntArray, vertices: IntArray, vectors: FloatArray, d: FloatArray
) -> FloatArray:
    """Do what the function in `vertex_rows` does."""
    products = np.empty(len(starts) - 1)
    for row in range(len(products)):
        products[row] = _product(starts, vertices, vectors, d, row)
    return products


@compile_loop
def row_sums(
    starts: IntArray, vertices: IntArray, vectors: FloatArray, weights: FloatArray, n_points: int
) -> FloatArray:
    """Do what the function in `vertex_rows` does."""
    sums = np.zeros(3 * n_points)
    for row in range(len(weights)):
        if weights[row] != 0.0:
            _add(starts, vertices, vectors, weights[row], row, sums)
    return sums


@compile_loop
def squared_product(
    starts: IntArray, vertices: IntArray, vectors: FloatArray, weights: FloatArray, d: FloatArray
) -> FloatArray:
    """Do what the function in `vertex_rows` does."""
    sums = np.zeros(len(d))
    # Row by row, so that each is still at hand when it is added.
    for row in range(len(weights)):
        if weights[row] != 0.0:
            change = weights[row] * _product(starts, vertices, vectors, d, row)
            _add(starts, vertices, vectors, change, row, sums)
    return sums


@compile_loop
def _product(
    starts: IntArray, vertices: IntArray, vectors: FloatArray, d: FloatArray, row: int
) -> float:
    x, y, z = 0.0, 0.0, 0.0
    # Numbers that cannot be negative spare a look at each index.
    for p in range(np.uint64(starts[row]), np.uint64(starts[row + 1])):
        v = np.uint64(3) * np.uint64(vertices[p])
        x += vectors[p, 0] * d[v]
        y += vectors[p, 1] * d[v + np.uint64(1)]
        z += vectors[p, 2] * d[v + np.uint64(2)]
    return x + y + z


@compile_loop
def _add(
    starts: IntArray,
    vertices: IntArray,
    vectors: FloatArray,
    weight: float,
    row: int,
    sums: FloatArray,
) -> None:
    for p in range(np.uint64(starts[row]), np.uint64(starts[row + 1])):
        v = np.uint64(3) * np.uint64(vertices[p])
        sums[v] += weight * vectors[p, 0]
        sums[v + np.uint64(1)] += weight * vectors[p, 1]
        sums[v + np.uint64(2)] += weight * vectors[p, 2]


@compile_loop
def inverted_blocks(blocks: FloatArray) -> FloatArray:
    """Do what the function in `block_woodbury` does."""
    inverse = np.empty_like(blocks)
    for n in range(len(blocks)):
        a, b, c = blocks[n, 0, 0], blocks[n, 0, 1], blocks[n, 0, 2]
        d, e, f = blocks[n, 1, 1], blocks[n, 1, 2], blocks[n, 2, 2]
        # Cholesky: cofactors would cancel where one direction is far dearer than the others.
        p = np.sqrt(a)
        q, r = b / p, c / p
        s = np.sqrt(d - q * q)
        t = (e - q * r) / s
        u = np.sqrt(f - r * r - t * t)
        # The inverse of the factor, and its square.
        k, m = -q / (p * s), -t / (s * u)
        j = (q * t - r * s) / (p * s * u)
        p, s, u = 1.0 / p, 1.0 / s, 1.0 / u
        inverse[n, 0, 0] = p * p + k * k + j * j
        inverse[n, 0, 1] = inverse[n, 1, 0] = k * s + j * m
        inverse[n, 0, 2] = inverse[n, 2, 0] = j * u
        inverse[n, 1, 1] = s * s + m * m
        inverse[n, 1, 2] = inverse[n, 2, 1] = m * u
        inverse[n, 2, 2] = u * u
    return inverse


@compile_loop
def places_at_vertices(
    starts: IntArray, vertices: IntArray, n_rows: int, n_points: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Do what the function in `block_woodbury` does."""
    n_matrices, last = (len(starts) - 1) // n_rows, np.full(n_points, -1)
    begins = np.zeros(n_points + 1, np.int64)
    for k in range(n_rows):
        for matrix in range(n_matrices):
            row = n_rows * matrix + k
            for p in range(starts[row], starts[row + 1]):
                v = vertices[p]
                if last[v] != k:
                    last[v] = k
                    begins[v + 1] += 1
    for v in range(n_points):
        begins[v + 1] += begins[v]
    means, places = np.empty(begins[n_points], np.int64), np.empty(len(vertices), np.int64)
    # Where those of each vertex end so far.
    ends = begins[:-1].copy()
    last[:] = -1
    for k in range(n_rows):
        for matrix in range(n_matrices):
            row = n_rows * matrix + k
            for p in range(starts[row], starts[row + 1]):
                v = vertices[p]
                if last[v] != k:
                    last[v] = k
                    means[ends[v]] = k
                    ends[v] += 1
                places[p] = ends[v] - 1
    return begins, means, places


@compile_loop
def sums_at_places(
    starts: IntArray, vectors: FloatArray, places: IntArray, shares: FloatArray, n_places: int
) -> FloatArray:
    """Do what the function in `block_woodbury` does."""
    sums = np.zeros((n_places, 3))
    for row in range(len(shares)):
        share = shares[row]
        if share == 0.0:
            continue
        for p in range(np.uint64(starts[row]), np.uint64(starts[row + 1])):
            place = np.uint64(places[p])
            sums[place, 0] += share * vectors[p, 0]
            sums[place, 1] += share * vectors[p, 1]
            sums[place, 2] += share * vectors[p, 2]
    return sums


@compile_loop
def small_matrix(
    begins: IntArray, means: IntArray, vectors: FloatArray, inverse: FloatArray, n_rows: int
) -> FloatArray:
    """Do what the function in `block_woodbury` does."""
    small = np.zeros((n_rows, n_rows))
    for v in range(len(inverse)):
        B = inverse[v]
        for p in range(begins[v], begins[v + 1]):
            x, y, z = vectors[p, 0], vectors[p, 1], vectors[p, 2]
            a = B[0, 0] * x + B[0, 1] * y + B[0, 2] * z
            b = B[1, 0] * x + B[1, 1] * y + B[1, 2] * z
            c = B[2, 0] * x + B[2, 1] * y + B[2, 2] * z
            # Means are in order: no farther than the diagonal.
            for q in range(begins[v], p + 1):
                product = a * vectors[q, 0] + b * vectors[q, 1] + c * vectors[q, 2]
                small[means[p], means[q]] += product
    for i in range(n_rows):
        for j in range(i):
            small[j, i] = small[i, j]
    return small


@compile_loop
def seen_by_rows(
    begins: IntArray,
    means: IntArray,
    vectors: FloatArray,
    inverse: FloatArray,
    r: FloatArray,
    n_rows: int,
) -> FloatArray:
    """Do what the function in `block_woodbury` does."""
    seen = np.zeros(n_rows)
    for v in range(len(inverse)):
        B, x, y, z = inverse[v], r[3 * v], r[3 * v + 1], r[3 * v + 2]
        a = B[0, 0] * x + B[0, 1] * y + B[0, 2] * z
        b = B[1, 0] * x + B[1, 1] * y + B[1, 2] * z
        c = B[2, 0] * x + B[2, 1] * y + B[2, 2] * z
        for p in range(begins[v], begins[v + 1]):
            seen[means[p]] += a * vectors[p, 0] + b * vectors[p, 1] + c * vectors[p, 2]
    return seen


@compile_loop
def corrected(
    begins: IntArray,
    means: IntArray,
    vectors: FloatArray,
    inverse: FloatArray,
    r: FloatArray,
    weights: FloatArray,
) -> FloatArray:
    """Do what the function in `block_woodbury` does."""
    found = np.empty_like(r)
    for v in range(len(inverse)):
        B, x, y, z = inverse[v], r[3 * v], r[3 * v + 1], r[3 * v + 2]
        for p in range(begins[v], begins[v + 1]):
            weight = weights[means[p]]
            x -= weight * vectors[p, 0]
            y -= weight * vectors[p, 1]
            z -= weight * vectors[p, 2]
        for i in range(3):
            found[3 * v + i] = B[i, 0] * x + B[i, 1] * y + B[i, 2] * z
    return found


@compile_loop
def strains(
    F: IntArray, corner_products: FloatArray, double_areas: FloatArray, d: FloatArray
) -> FloatArray:
    """Do what the function in `triangle_energy` does."""
    found = np.empty(len(F))
    for f in range(len(F)):
        square = 0.0
        for k in range(3):
            i, j = 3 * F[f, (k + 1) % 3], 3 * F[f, (k + 2) % 3]
            x, y, z = d[j] - d[i], d[j + 1] - d[i + 1], d[j + 2] - d[i + 2]
            square += corner_products[f, k] * (x * x + y * y + z * z)
        found[f] = np.sqrt(max(square, 0.0)) / double_areas[f]
    return found


@compile_loop
def energy_product(
    blocks: FloatArray, F: IntArray, side_costs: FloatArray, d: FloatArray
) -> FloatArray:
    """Do what the function in `triangle_energy` does."""
    product = np.empty_like(d)
    for n in range(len(blocks)):
        x, y, z = d[3 * n], d[3 * n + 1], d[3 * n + 2]
        for i in range(3):
            product[3 * n + i] = blocks[n, i, 0] * x + blocks[n, i, 1] * y + blocks[n, i, 2] * z
    for f in range(len(F)):
        a, b, c = 3 * F[f, 0], 3 * F[f, 1], 3 * F[f, 2]
        u, v, w = side_costs[f, 0], side_costs[f, 1], side_costs[f, 2]
        for x in range(3):
            bc, ca, ab = (
                u * (d[c + x] - d[b + x]),
                v * (d[a + x] - d[c + x]),
                w * (d[b + x] - d[a + x]),
            )
            product[a + x] += ca - ab
            product[b + x] += ab - bc
            product[c + x] += bc - ca
    return product


@compile_loop
def diagonal_blocks(blocks: FloatArray, F: IntArray, side_costs: FloatArray) -> FloatArray:
    """Do what the function in `triangle_energy` does."""
    diagonal = blocks.copy()
    for f in range(len(F)):
        for k in range(3):
            # Of a side that has collapsed, the ends do not come apart.
            if F[f, (k + 1) % 3] == F[f, (k + 2) % 3]:
                continue
            for corner in (F[f, (k + 1) % 3], F[f, (k + 2) % 3]):
                for x in range(3):
                    diagonal[corner, x, x] += side_costs[f, k]
    return diagonal
