"""Loops that numba compiles: SHA-256 of many keys side by side (FIPS 180-4).

What is hashed of `LANES` keys stands in rows of so many words, and what is done to a row is one
instruction for several keys at once.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.hashing.hmac_sha256 import INNER_PAD, OUTER_PAD
from meshmark.kernels import compile_loop

Words = NDArray[np.uint32]

LANES = 64
# Words of a state, of a block, and rounds.
STATE, BLOCK_WORDS, ROUNDS = 8, 16, 64
_PAD_INNER, _PAD_OUTER = np.uint32(INNER_PAD * 0x01010101), np.uint32(OUTER_PAD * 0x01010101)
# A digest's block ends as that of 96 bytes: a key's block, and the digest.
_END, _BITS = np.uint32(1 << 31), np.uint32(8 * 96)


# The first bits of the fractions of roots of the first primes.
_PRIMES = [n for n in range(2, 312) if all(n % m for m in range(2, n))]
_START: Words = (2.0**32 * (np.sqrt(_PRIMES[:STATE]) % 1.0)).astype(np.uint32)
_ROUND_CONSTANTS: Words = (2.0**32 * (np.cbrt(_PRIMES) % 1.0)).astype(np.uint32)


@compile_loop
def codes(keys: Words, blocks: Words, first: NDArray[Any], n_words: int) -> Words:
    """Compute the first words of the codes of M messages under n keys, (M, n_words, n).

    Parameters
    ----------
    keys : (8, n) uint32
    blocks : (B, 16) uint32
        The messages' blocks, padded.
    first : (M + 1,) int64
        First block of each message.
    """
    n = keys.shape[1]
    found = np.empty((len(first) - 1, n_words, n), np.uint32)
    inner, outer = np.empty(STATE * LANES, np.uint32), np.empty(STATE * LANES, np.uint32)
    state, scheduled = np.empty_like(inner), np.empty(ROUNDS * LANES, np.uint32)
    for begin in range(0, n, LANES):
        some = min(LANES, n - begin)
        _begin_by_key(keys, begin, some, _PAD_INNER, scheduled, inner)
        _begin_by_key(keys, begin, some, _PAD_OUTER, scheduled, outer)
        for m in range(len(first) - 1):
            _copy(inner, state)
            for b in range(first[m], first[m + 1]):
                for t in range(BLOCK_WORDS):
                    _fill(scheduled, t, blocks[b, t])
                _compress(scheduled, state)
            _copy(state, scheduled)
            for t in range(STATE, BLOCK_WORDS):
                _fill(scheduled, t, np.uint32(0))
            _fill(scheduled, STATE, _END)
            _fill(scheduled, BLOCK_WORDS - 1, _BITS)
            _copy(outer, state)
            _compress(scheduled, state)
            for t in range(n_words):
                for i in range(some):
                    found[m, t, begin + i] = state[t * LANES + i]
    return found


@compile_loop
def _fill(rows: Words, row: int, word: Any) -> None:
    for i in range(LANES):
        rows[row * LANES + i] = word


@compile_loop
def _copy(source: Words, target: Words) -> None:
    for i in range(len(source)):
        target[i] = source[i]


@compile_loop
def _begin_by_key(
    keys: Words, begin: int, some: int, pad: Any, scheduled: Words, state: Words
) -> None:
    """Hash the first block of a code's inner or outer hash, which the key fills."""
    for t in range(BLOCK_WORDS):
        _fill(scheduled, t, pad)
    for t in range(len(keys)):
        for i in range(some):
            scheduled[t * LANES + i] = np.uint32(keys[t, begin + i] ^ pad)
    for t in range(STATE):
        _fill(state, t, _START[t])
    _compress(scheduled, state)


@compile_loop
def _compress(w: Words, state: Words) -> None:
    """Hash a block, whose words are the first rows of w, into a state."""
    for t in range(BLOCK_WORDS, ROUNDS):
        for i in range(LANES):
            x, y = w[(t - 15) * LANES + i], w[(t - 2) * LANES + i]
            s0 = _turned(x, 7) ^ _turned(x, 18) ^ np.uint32(x >> 3)
            s1 = _turned(y, 17) ^ _turned(y, 19) ^ np.uint32(y >> 10)
            w[t * LANES + i] = np.uint32(w[(t - 16) * LANES + i] + s0 + w[(t - 7) * LANES + i] + s1)
    known = state.copy()
    # Eight rounds at a time: what is between them stays in registers.
    for r in range(0, ROUNDS, 8):
        for i in range(LANES):
            a, b = state[i], state[LANES + i]
            c, d = state[2 * LANES + i], state[3 * LANES + i]
            e, f = state[4 * LANES + i], state[5 * LANES + i]
            g, h = state[6 * LANES + i], state[7 * LANES + i]
            for t in range(r, r + 8):
                s1 = _turned(e, 6) ^ _turned(e, 11) ^ _turned(e, 25)
                choice = np.uint32((e & f) ^ (~e & g))
                one = np.uint32(h + s1 + choice + _ROUND_CONSTANTS[t] + w[t * LANES + i])
                s0 = _turned(a, 2) ^ _turned(a, 13) ^ _turned(a, 22)
                two = np.uint32(s0 + np.uint32((a & b) ^ (a & c) ^ (b & c)))
                h, g, f, e = g, f, e, np.uint32(d + one)
                d, c, b, a = c, b, a, np.uint32(one + two)
            state[i], state[LANES + i] = a, b
            state[2 * LANES + i], state[3 * LANES + i] = c, d
            state[4 * LANES + i], state[5 * LANES + i] = e, f
            state[6 * LANES + i], state[7 * LANES + i] = g, h
    for i in range(STATE * LANES):
        state[i] = np.uint32(state[i] + known[i])


@compile_loop
def _turned(x: Any, n: int) -> Any:
    """Rotate a word to the right."""
    return np.uint32(np.uint32(x >> n) | np.uint32(x << (32 - n)))
