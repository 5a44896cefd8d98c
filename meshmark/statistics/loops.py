"""Loops that numba compiles; what they stand in for is in `meshmark.statistics.sieve`.

What is done to all hypotheses of a block is an innermost loop of its own over `LANES`, which numba
turns into a few instructions.
"""

from __future__ import annotations

import numpy as np

from meshmark.arrays import IntArray
from meshmark.kernels import compile_loop
from meshmark.statistics.sieve import LANES, Octets, Steps

_LOW = np.int16(np.iinfo(np.int16).min)
# Keys whose sums fit into a processor's cache, and bytes that it reads at once.
KEYS_AT_ONCE, LINE = 512, 64


@compile_loop
def reached(
    steps: Steps, windows: IntArray, zeros: Steps, needed: Steps, octets: Octets
) -> IntArray:
    """List pairs of keys and hypotheses as the function of the same name does, for two bytes."""
    G, C = steps.shape[:2]
    J, n = zeros.shape[2], len(octets)
    table = _rows(2 * 256).reshape(2, 256, LANES)
    best, zero, need = _rows(1)[0], _rows(J), _rows(J)
    total = _rows(KEYS_AT_ONCE * J).reshape(KEYS_AT_ONCE, J, LANES)
    left = np.empty(KEYS_AT_ONCE, np.int64)
    found, n_found = np.empty((n, 2), np.int64), 0
    for g in range(G):
        for start in range(0, n, KEYS_AT_ONCE):
            n_left = min(KEYS_AT_ONCE, n - start)
            for i in range(n_left):
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
                    begin, end = windows[g, c, 0], windows[g, c, 1]
                    _find_best_scores(table, octets, start + i, begin, end, best)
                    _add(best, zero, total, i)
                    if all_stay or _has_reached(total, need, i):
                        left[kept] = i
                        kept += 1
                n_left = kept
            if n_found + n_left * LANES > len(found):
                found = _with_room(found, n_left * LANES)
            for a in range(n_left):
                n_found = _list_lanes(total, need, left[a], start, g * LANES, found, n_found)
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
    for lane in range(LANES):
        best[lane] = _LOW
    for m in range(begin, end, 2):
        k = min(m + 1, end - 1)
        p, q, r, s = octets[i, m, 0], octets[i, m, 1], octets[i, k, 0], octets[i, k, 1]
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
    total: Steps, need: Steps, i: int, start: int, first: int, found: IntArray, n_found: int
) -> int:
    """List hypotheses of a block that a key has reached; return how many there are by now."""
    for lane in range(LANES):
        enough = False
        for j in range(len(need)):
            enough |= total[i, j, lane] >= need[j, lane]
        if enough:
            found[n_found, 0], found[n_found, 1] = start + i, first + lane
            n_found += 1
    return n_found
