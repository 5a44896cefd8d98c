"""Loops that factor matrices of one pattern and solve with the factors; numba compiles them.

Arrays are contiguous, of float64 or int64. Permuted matrices are symmetric, and kept column by
column above the diagonal.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compile_loop


@compile_loop
def elimination_tree(start: IntArray, rows: IntArray) -> tuple[IntArray, IntArray]:
    """Parents of columns (N,), -1 at a root, and where those of the factor start (N + 1,)."""
    n = len(start) - 1
    parent, seen, filled = np.full(n, -1), np.full(n, -1), np.zeros(n + 1, np.int64)
    for k in range(n):
        seen[k] = k
        for p in range(start[k], start[k + 1]):
            i = rows[p]
            while seen[i] != k:
                if parent[i] < 0:
                    parent[i] = k
                filled[i + 1] += 1
                seen[i] = k
                i = parent[i]
    for k in range(n):
        filled[k + 1] += filled[k]
    return parent, filled


@compile_loop
def post_order(parent: IntArray) -> IntArray:
    """Compute numbers of a forest's nodes, children before parents, subtree after subtree, (N,)."""
    n = len(parent)
    child, sibling = np.full(n + 1, -1), np.full(n, -1)
    for i in range(n - 1, -1, -1):
        above = parent[i] if parent[i] >= 0 else n
        sibling[i], child[above] = child[above], i
    number, path = np.empty(n, np.int64), np.empty(n + 1, np.int64)
    path[0], depth, count = n, 1, 0
    while depth > 0:
        node = path[depth - 1]
        if child[node] >= 0:
            path[depth] = child[node]
            child[node] = sibling[child[node]]
            depth += 1
        else:
            depth -= 1
            if node < n:
                number[node] = count
                count += 1
    return number


@compile_loop
def lifted_places(F: IntArray, place: IntArray, parent: IntArray, first: IntArray) -> IntArray:
    """Change an order of elimination for triangles other than those that it was made for, (N,).

    `parent` and `first` (N,) are the parent and the first descendant of each place in its tree, of
    numbers in post-order. Sides must join descendants: where one does not, its lower end goes up to
    where both ends come together.
    """
    n = len(place)
    node = place.copy()
    for f in range(len(F)):
        for k in range(3):
            i, j = F[f, k], F[f, (k + 1) % 3]
            if node[i] > node[j]:
                i, j = j, i
            if node[i] >= first[node[j]]:
                continue
            above = node[i]
            while above >= 0 and not first[above] <= node[j] <= above:
                above = parent[above]
            node[i] = above if above >= 0 else n - 1
    # Of several at a node, the first vertex comes first.
    start = np.zeros(n + 1, np.int64)
    for i in range(n):
        start[node[i] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    lifted = np.empty(n, np.int64)
    for i in range(n):
        lifted[i] = start[node[i]]
        start[node[i]] += 1
    return lifted


@compile_loop
def factors(
    start: IntArray,
    rows: IntArray,
    values: FloatArray,
    diagonals: FloatArray,
    scales: FloatArray,
    parent: IntArray,
    filled: IntArray,
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Factor two matrices of one pattern into L D L^T, row by row of L.

    They are `diagonals` (2, N), and `values` times `scales` (2,) above them. Returns the rows of L,
    its values (2, nnz), and D (2, N), with a zero where a matrix is not positive definite.
    """
    n = len(parent)
    below, L, D = np.empty(filled[n], np.int64), np.empty((2, filled[n])), np.zeros((2, n))
    end, seen = filled[:n].copy(), np.full(n, -1)
    y, z = np.zeros(n), np.zeros(n)
    pattern, path = np.empty(n, np.int64), np.empty(n, np.int64)
    for k in range(n):
        top, seen[k] = n, k
        for p in range(start[k], start[k + 1]):
            i = rows[p]
            y[i] += scales[0] * values[p]
            z[i] += scales[1] * values[p]
            length = 0
            while seen[i] != k:
                path[length], seen[i] = i, k
                length += 1
                i = parent[i]
            while length > 0:
                length -= 1
                top -= 1
                pattern[top] = path[length]
        first, second = diagonals[0, k], diagonals[1, k]
        for q in range(top, n):
            i = pattern[q]
            yi, zi = y[i], z[i]
            y[i], z[i] = 0.0, 0.0
            for p in range(filled[i], end[i]):
                y[below[p]] -= L[0, p] * yi
                z[below[p]] -= L[1, p] * zi
            p = end[i]
            below[p], L[0, p], L[1, p] = k, yi / D[0, i], zi / D[1, i]
            first -= L[0, p] * yi
            second -= L[1, p] * zi
            end[i] += 1
        if not (first > 0.0 and second > 0.0):
            break
        D[0, k], D[1, k] = first, second
    return below, L, D


@compile_loop
def solve(filled: IntArray, below: IntArray, L: FloatArray, D: FloatArray, X: FloatArray) -> None:
    """Solve L D L^T for right-hand sides X (N, S), in place."""
    n, n_sides = X.shape
    if n_sides == 1:
        _solve_one(filled, below, L, D, X[:, 0])
        return
    for j in range(n):
        some = False
        for s in range(n_sides):
            some |= X[j, s] != 0.0
        if some:
            for p in range(filled[j], filled[j + 1]):
                i, value = below[p], L[p]
                for s in range(n_sides):
                    X[i, s] -= value * X[j, s]
    for j in range(n - 1, -1, -1):
        for s in range(n_sides):
            X[j, s] /= D[j]
        for p in range(filled[j], filled[j + 1]):
            i, value = below[p], L[p]
            for s in range(n_sides):
                X[j, s] -= value * X[i, s]


@compile_loop
def _solve_one(
    filled: IntArray, below: IntArray, L: FloatArray, D: FloatArray, x: FloatArray
) -> None:
    n = len(x)
    for j in range(n):
        if x[j] != 0.0:
            for p in range(filled[j], filled[j + 1]):
                x[below[p]] -= L[p] * x[j]
    for j in range(n - 1, -1, -1):
        value = x[j] / D[j]
        for p in range(filled[j], filled[j + 1]):
            value -= L[p] * x[below[p]]
        x[j] = value
