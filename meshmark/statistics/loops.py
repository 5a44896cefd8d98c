"""Loops that numba compiles; functions of the same names say what they do.

Those are in `meshmark.statistics.sieve` and `word_windows`.

What is done to all hypotheses of a block is an innermost loop of its own over `LANES`, which numba
turns into a few instructions.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compile_loop
from meshmark.statistics.sieve import LANES, TINY, Octets, Steps
from meshmark.statistics.word_windows import WINDOW_SIZE

# Bytes that a processor reads at once.
LINE = 64


@compile_loop
def reached(
    steps: Steps, windows: IntArray, zeros: Steps, needed: Steps, octets: Octets
) -> IntArray:
    """List pairs of keys and hypotheses as the function of the same name does, for two bytes."""
    G, C = steps.shape[:2]
    J, n = zeros.shape[2], len(octets)
    table = _rows(2 * 256).reshape(2, 256, LANES)
    best, zero, need = _rows(1)[0], _rows(J), _rows(J)
    total, left = _rows(n * J).reshape(n, J, LANES), np.empty(n, np.int64)
    found, n_found = np.empty((n, 2), np.int64), 0
    for g in range(G):
        n_left = n
        for i in range(n):
            left[i] = i
        _clear(total)
        for c in range(C):
            if n_left == 0:
                break
            _fill(table, steps, g, c)
            _copy(zeros, g, c, zero)
            # No sum is below 0.
            all_stay = _copy(needed, g, c, need) <= 0
            kept = 0
            for a in range(n_left):
                i = left[a]
                _find_best_scores(table, octets, i, windows[g, c, 0], windows[g, c, 1], best)
                _add(best, zero, total, i)
                if all_stay or _has_reached(total, need, i):
                    left[kept] = i
                    kept += 1
            n_left = kept
        if n_found + n_left * LANES > len(found):
            found = _with_room(found, n_left * LANES)
        for a in range(n_left):
            n_found = _list_lanes(total, need, left[a], g * LANES, found, n_found)
    return found[:n_found]


@compile_loop
def _rows(n: int) -> Steps:
    """Make room for rows (n, L) that begin where a processor reads quickest."""
    room = np.empty(n * LANES + LINE, np.int16)
    first = -room.ctypes.data % LINE // 2
    return room[first : first + n * LANES].reshape(n, LANES)


@compile_loop
def _clear(total: Steps) -> None:
    for i in range(total.shape[0]):
        for j in range(total.shape[1]):
            for lane in range(LANES):
                total[i, j, lane] = 0


@compile_loop
def _copy(rows: Steps, g: int, c: int, target: Steps) -> int:
    """Copy rows of a block (G, C, J, L), and return the least number in them."""
    least = rows[g, c, 0, 0]
    for j in range(len(target)):
        for lane in range(LANES):
            target[j, lane] = rows[g, c, j, lane]
            least = min(least, rows[g, c, j, lane])
    return least


@compile_loop
def _fill(table: Steps, steps: Steps, g: int, c: int) -> None:
    """Sum chips (G, C, 16, L) by the signs that each of two bytes stands for, (2, 256, L)."""
    for octet in range(2):
        for lane in range(LANES):
            table[octet, 0, lane] = 0
        size = 1
        for chip in range(8 * octet + 7, 8 * octet - 1, -1):
            for x in range(size):
                for lane in range(LANES):
                    value, step = table[octet, x, lane], steps[g, c, chip, lane]
                    table[octet, x, lane] = value - step
                    table[octet, x + size, lane] = value + step
            size *= 2


@compile_loop
def _find_best_scores(
    table: Steps, octets: Octets, i: int, begin: int, end: int, best: Steps
) -> None:
    """Take the best score of some words of a key (n, U, 2), two of them at a time."""
    odd = (end - begin) % 2
    k = begin + 1 - odd
    p, q, r, s = octets[i, begin, 0], octets[i, begin, 1], octets[i, k, 0], octets[i, k, 1]
    for lane in range(LANES):
        one = np.int16(table[0, p, lane] + table[1, q, lane])
        best[lane] = max(one, np.int16(table[0, r, lane] + table[1, s, lane]))
    for m in range(begin + 2 - odd, end, 2):
        p, q, r, s = octets[i, m, 0], octets[i, m, 1], octets[i, m + 1, 0], octets[i, m + 1, 1]
        for lane in range(LANES):
            one = np.int16(table[0, p, lane] + table[1, q, lane])
            other = np.int16(table[0, r, lane] + table[1, s, lane])
            best[lane] = max(best[lane], max(one, other))


@compile_loop
def _add(best: Steps, zero: Steps, total: Steps, i: int) -> None:
    """Add to a key's sums (n, J, L) what its scores exceed zeros by."""
    for j in range(len(zero)):
        for lane in range(LANES):
            over = max(best[lane], zero[j, lane]) - zero[j, lane]
            total[i, j, lane] = np.int16(total[i, j, lane] + over)


@compile_loop
def _has_reached(total: Steps, need: Steps, i: int) -> bool:
    """Tell whether any of a key's sums has reached what it needs."""
    hope = False
    for j in range(len(need)):
        enough = False
        for lane in range(LANES):
            enough = enough | (total[i, j, lane] >= need[j, lane])
        hope |= enough
    return hope


@compile_loop
def _with_room(found: IntArray, n: int) -> IntArray:
    """Make room for n pairs more, and for as many again as there were."""
    room = np.empty((2 * len(found) + n, 2), np.int64)
    for i in range(len(found)):
        room[i, 0], room[i, 1] = found[i, 0], found[i, 1]
    return room


@compile_loop
def _list_lanes(
    total: Steps, need: Steps, i: int, first: int, found: IntArray, n_found: int
) -> int:
    """List hypotheses of a block that a key has reached; return how many there are by now."""
    for lane in range(LANES):
        enough = False
        for j in range(len(need)):
            enough |= total[i, j, lane] >= need[j, lane]
        if enough:
            found[n_found, 0], found[n_found, 1] = i, first + lane
            n_found += 1
    return n_found


@compile_loop
def in_steps(
    S: FloatArray, scale: float, levels: FloatArray
) -> tuple[Steps, FloatArray, FloatArray, FloatArray]:
    """Round evidence to whole steps, and sum over chips what bounds are made of."""
    R, C, K = S.shape
    T = levels.shape[1]
    steps = np.zeros((C, (K + 7) // 8 * 8, R), np.int16)
    size, rounding, log_null = np.zeros((C, R)), np.zeros((C, R)), np.zeros((C, T, R))
    sums = np.empty(T)
    for r in range(R):
        for c in range(C):
            for t in range(T):
                sums[t] = 0.0
            for k in range(K):
                exact = scale * S[r, c, k]
                step = np.rint(exact)
                steps[c, k, r] = np.int16(step)
                size[c, r] += abs(step)
                rounding[c, r] += abs(exact - step)
                below = int(np.floor(abs(exact) + TINY))
                for t in range(T):
                    sums[t] += levels[below, t]
            for t in range(T):
                log_null[c, t, r] = sums[t]
    return steps, size, rounding, log_null


@compile_loop
def assignment_sums(first: IntArray, x: FloatArray, idle: FloatArray) -> FloatArray:
    """Sum prod x[c, word of c] over all assignments that hold no word twice, (N,)."""
    N, C = first.shape
    size = 1 << WINDOW_SIZE
    found, table, grown = np.empty(N), np.empty(size), np.empty(size)
    order = np.empty(C, np.int64)
    for n in range(N):
        for c in range(C):
            i = c
            while i > 0 and first[n, order[i - 1]] > first[n, c]:
                order[i] = order[i - 1]
                i -= 1
            order[i] = c
        for s in range(size):
            table[s] = 1.0 if s == 0 else 0.0
        for i in range(C):
            c = order[i]
            step = 0 if i == 0 else min(first[n, c] - first[n, order[i - 1]], WINDOW_SIZE)
            kept = size >> step
            for s in range(kept):
                total = 0.0
                for low in range(1 << step):
                    total += table[(s << step) + low]
                table[s] = total
            for s in range(kept, size):
                table[s] = 0.0
            for s in range(size):
                grown[s] = table[s] * idle[n, c]
            for m in range(WINDOW_SIZE):
                for s in range(size):
                    if not s & (1 << m):
                        grown[s | (1 << m)] += table[s] * x[n, c, m]
            table, grown = grown, table
        found[n] = 0.0
        for s in range(size):
            found[n] += table[s]
    return found
