"""HMAC-SHA256 of a few messages under many keys: by loops where there are many, or by OpenSSL.

HMAC is a hash of a hash, each after a block made from the key [1]_. Of a message, the same blocks
are hashed for all keys, so that compiled loops hash them for many keys side by side [2]_.

References
----------
.. [1] H. Krawczyk, M. Bellare, R. Canetti, "HMAC: Keyed-Hashing for Message Authentication",
   RFC 2104, 1997. https://doi.org/10.17487/RFC2104
.. [2] "Secure Hash Standard (SHS)", FIPS 180-4, 2015. https://doi.org/10.6028/NIST.FIPS.180-4
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.kernels import load_loops

LOOPS = "meshmark.hashing.loops"
KEY_BYTES = DIGEST_BYTES = 32
# Bytes that are hashed at a time.
BLOCK = 64
# Codes that take longer one by one than loops take to be imported, or compiled if need be.
MANY = 500_000

# HMAC's two blocks are the key with each byte changed so.
INNER_PAD, OUTER_PAD = 0x36, 0x5C
_INNER, _OUTER = (bytes(b ^ pad for b in range(256)) for pad in (INNER_PAD, OUTER_PAD))


def codes(keys: Sequence[bytes], messages: Sequence[bytes], n_bytes: int) -> NDArray[np.uint8]:
    """Compute the codes of all messages under all keys.

    Parameters
    ----------
    keys : sequence of bytes
        Of `KEY_BYTES` each.
    n_bytes : int
        How much of each code is asked for, at most `DIGEST_BYTES`.

    Returns
    -------
    (len(keys), len(messages), n_bytes) uint8
    """
    loops = load_loops(LOOPS) if len(keys) * len(messages) >= MANY else None
    if loops is None:
        return _one_by_one(keys, messages, n_bytes)
    blocks, first = _padded(messages)
    words = np.frombuffer(b"".join(keys), ">u4").reshape(len(keys), -1).T
    found = loops.codes(np.ascontiguousarray(words, np.uint32), blocks, first, -(-n_bytes // 4))
    octets = np.ascontiguousarray(found.transpose(2, 0, 1)).astype(">u4").view(np.uint8)
    return octets[..., :n_bytes]


def _one_by_one(
    keys: Sequence[bytes], messages: Sequence[bytes], n_bytes: int
) -> NDArray[np.uint8]:
    """Compute the same by OpenSSL; what a key's codes begin with is hashed once."""
    derived = []
    for key in keys:
        block = key.ljust(BLOCK, b"\0")
        inner = hashlib.sha256(block.translate(_INNER))
        outer = hashlib.sha256(block.translate(_OUTER))
        for message in messages:
            inside, outside = inner.copy(), outer.copy()
            inside.update(message)
            outside.update(inside.digest())
            derived.append(outside.digest())
    shape = (len(keys), len(messages), DIGEST_BYTES)
    return np.frombuffer(b"".join(derived), np.uint8).reshape(shape)[..., :n_bytes]


def _padded(messages: Sequence[bytes]) -> tuple[NDArray[np.uint32], NDArray[Any]]:
    """Lay messages out as hashed after one block: words (B, 16), and each one's first block."""
    whole, first = [], [0]
    for message in messages:
        zeros = -(len(message) + 9) % BLOCK
        bits = 8 * (BLOCK + len(message))
        whole.append(message + b"\x80" + bytes(zeros) + bits.to_bytes(8, "big"))
        first.append(first[-1] + len(whole[-1]) // BLOCK)
    words = np.frombuffer(b"".join(whole), ">u4").reshape(-1, BLOCK // 4)
    return words.astype(np.uint32), np.array(first)
