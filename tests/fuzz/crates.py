"""Alters USD's binary layers where it matters: section by section, below their compression.

A crate begins with `PXR-USDC`, 8 bytes of version, and the place of its table of contents: a
count, and for each section a name of 16 bytes, a start and a size. Within a section, blocks of LZ4
follow one or more 64-bit counts.
"""

from __future__ import annotations

import struct
from random import Random

from .texts import altered_bytes

ENTRY = struct.Struct("<16sqq")
# Counts before the first block, the last of which is not yet the block's own size.
COUNTS = {b"TOKENS": 2, b"FIELDS": 1, b"FIELDSETS": 1, b"PATHS": 2, b"SPECS": 1}


def altered_crate(data: bytes, rng: Random) -> bytes:
    """Alter a crate somewhere; each section is as likely as any other."""
    try:
        sections = _sections(data)
        first = min(start for _, start, _ in sections)
    except (struct.error, ValueError):
        return altered_bytes(data, rng)
    toc = struct.unpack_from("<q", data, 16)[0]
    ends = {
        # The head, the values, the table, and all of it.
        -4: (0, 24),
        -3: (24, first),
        -2: (toc, len(data)),
        -1: (0, len(data)),
    }
    chosen = rng.choice([*ends, -3, -3, -3, *range(len(sections))])
    if chosen in ends:
        start, stop = ends[chosen]
        return data[:start] + altered_bytes(data[start:stop], rng) + data[stop:]
    name, start, size = sections[chosen]
    content = data[start : start + size]
    inner = rng.random() < 0.7 and name in COUNTS
    content = _altered_block(content, COUNTS[name], rng) if inner else altered_bytes(content, rng)
    return _replaced(data, chosen, content)


def _sections(data: bytes) -> list[tuple[bytes, int, int]]:
    toc = struct.unpack_from("<q", data, 16)[0]
    (count,) = struct.unpack_from("<Q", data, toc)
    entries = (ENTRY.unpack_from(data, toc + 8 + ENTRY.size * i) for i in range(min(count, 16)))
    return [(name.rstrip(b"\0"), start, size) for name, start, size in entries]


def _replaced(data: bytes, number: int, content: bytes) -> bytes:
    """Put a section at the end of the file, where its size is free."""
    toc = struct.unpack_from("<q", data, 16)[0]
    at = toc + 8 + ENTRY.size * number
    name = ENTRY.unpack_from(data, at)[0]
    entry = ENTRY.pack(name, len(data), len(content))
    return data[:at] + entry + data[at + ENTRY.size :] + content


def _altered_block(section: bytes, counts: int, rng: Random) -> bytes:
    places, at = [], 8 * counts
    while at + 8 <= len(section):
        (size,) = struct.unpack_from("<Q", section, at)
        if not 0 < size <= len(section) - at - 8:
            break
        places.append((at, size))
        at += 8 + size
    if not places:
        return altered_bytes(section, rng)
    at, size = rng.choice(places)
    plain = altered_bytes(_unpacked(section[at + 8 : at + 8 + size]), rng)
    packed = _packed(plain)
    return section[:at] + struct.pack("<Q", len(packed)) + packed + section[at + 8 + size :]


def _unpacked(data: bytes) -> bytes:
    """Undo USD's fast compression of small blocks: a zero, then one block of LZ4."""
    out, at = bytearray(), 1
    while at < len(data):
        token = data[at]
        literals, at = _length(data, at + 1, token >> 4)
        out += data[at : at + literals]
        at += literals
        if at >= len(data):
            break
        offset = data[at] | data[at + 1] << 8
        length, at = _length(data, at + 2, token & 15)
        for _ in range(length + 4):
            out.append(out[-offset])
    return bytes(out)


def _length(data: bytes, at: int, nibble: int) -> tuple[int, int]:
    length = nibble
    more = nibble == 15
    while more:
        length += data[at]
        more = data[at] == 255
        at += 1
    return length, at


def _packed(plain: bytes) -> bytes:
    """Spell bytes as LZ4 literals, which any reader of it takes."""
    n = len(plain)
    if n < 15:
        return b"\0" + bytes([n << 4]) + plain
    full, rest = divmod(n - 15, 255)
    return b"\0\xf0" + b"\xff" * full + bytes([rest]) + plain
