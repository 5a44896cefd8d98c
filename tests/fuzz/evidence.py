"""Alters files of evidence below their seal: the header, the numbers, the stream they are in."""

from __future__ import annotations

import gzip
import hmac
import json
from random import Random

from .archives import altered_json, json_text
from .texts import altered_bytes

# The secret that inputs are sealed with, lest the seal be all that is tried.
SECRET = bytes(range(32, 64))
SEAL_BYTES = 32


def altered_evidence(data: bytes, rng: Random) -> bytes:
    """Alter a file of evidence."""
    if rng.random() < 0.1:
        return altered_bytes(data, rng)
    end = data.index(b"\n") + 1
    kind, stream = data[:end], data[end + SEAL_BYTES :]
    if rng.random() < 0.15:
        return _sealed(kind, altered_bytes(stream, rng))
    plain = gzip.decompress(stream)
    start = 4 + int.from_bytes(plain[:4], "little")
    length, header, arrays = plain[:4], plain[4:start], plain[start:]
    match rng.randrange(8):
        case 0:
            length = altered_bytes(length, rng)
        case 1 | 2:
            arrays = altered_bytes(arrays, rng)
        case _:
            header = json_text(altered_json(json.loads(header), rng), rng)
            length = len(header).to_bytes(4, "little")
            if rng.random() < 0.2:
                arrays = (arrays + bytes(1 << 12))[: rng.randrange(1 << 14)]
    return _sealed(kind, gzip.compress(length + header + arrays, 1, mtime=0))


def _sealed(kind: bytes, stream: bytes) -> bytes:
    return kind + hmac.digest(SECRET, kind + stream, "sha256") + stream
