"""Alters bytes of any kind, and text token by token."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from random import Random

SCRAPS = (
    b"\x00",
    b"\xff",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"\x80\x81",
    b"\xc3",
    b"\xed\xa0\x80",
    b"\xf0\x9f\x92\xa9",
    b"\n",
    b"\r",
    b"\r\n",
    b"\t",
    b"\x0b\x0c",
    b"\x1b[31m",
    b"\xe2\x80\xa8",
    b"\\",
    b'"',
    b"'",
    b"%s%n",
    b"{0}",
    b"#",
    b"@",
)
TOKEN = re.compile(
    rb"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|@[^@\n]*@|<[^>\n]*>|\"[^\"\n]*\"|[\w:]+|\s+|.",
    re.S,
)
DIGITS = b"-0123456789"
LETTERS = bytes([*range(65, 91), *range(97, 123), 95])
QUOTES = b'@<"'
VISIBLE = bytes(range(33, 256))
LONG = 5000
LONGEST = 1 << 24  # characters of a word that was lengthened again and again


def words_of(text: str) -> list[bytes]:
    """Split text at blanks."""
    return text.encode().split()


# Numbers that programs stumble over, and what only looks like numbers.
NUMBERS = words_of(
    """0 -0 -1 1 2 3 7 255 256 65536 2147483647 -2147483648 0.5 1e-3 1e-9 1e-30 1e-45 1e-310 1e9
    1e38 1e150 1e300 1e308"""
)
ODD_NUMBERS = words_of(
    """2147483648 4294967295 4294967296 9223372036854775807 18446744073709551616 3.5e38 1e999
    -1e999 nan -nan inf -inf 1e 0x10 1_0 1. .5 + - \u0661 \xb2 1,5 99999999999999999999999"""
)
# Integers of 1, 2, 4 and 8 bytes, and floats of 2, 4 and 8.
PATTERNS = [
    bytes.fromhex(word.decode())
    for word in words_of(
        """00 ff 7f 80 01 0000 ffff 007c 007e 00fc ff7f 00000000 ffffffff ffffff7f 00000080
        01000000 0000807f 0000c07f 000080ff 00000100 ffff7f7f 0000000000000000 ffffffffffffffff
        ffffffffffffff7f 0000000000000080 0100000000000000 000000000000f07f 000000000000f87f
        ffffffffffffef7f 0000000001000000 ffffff0000000000"""
    )
]


def altered_bytes(data: bytes, rng: Random, times: int | None = None) -> bytes:
    """Alter bytes in one to some places."""
    for _ in range(times or _few(rng)):
        data = rng.choice(_BYTE_STEPS)(data, rng)
    return data


def altered_text(data: bytes, rng: Random, words: Sequence[bytes]) -> bytes:
    """Alter text in one to some places; `words` are some that mean something in it."""
    for _ in range(_few(rng)):
        if rng.random() < 0.15:
            data = altered_bytes(data, rng, 1)
        else:
            data = rng.choice(_TEXT_STEPS)(data, rng, words)
    return data


def _few(rng: Random) -> int:
    return rng.choice((1, 1, 1, 1, 1, 1, 2, 2, 3, 8))


def _span(n: int, rng: Random, longest: int | None = None) -> tuple[int, int]:
    start = rng.randrange(n + 1)
    length = min(int(2 ** rng.uniform(0, 12)), longest or n, n - start)
    return start, start + length


def _flip(data: bytes, rng: Random) -> bytes:
    if not data:
        return data
    at = rng.randrange(len(data))
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def _pattern(data: bytes, rng: Random) -> bytes:
    piece = rng.choice(PATTERNS)
    at = rng.randrange(len(data) + 1)
    if rng.random() < 0.7:
        at -= at % len(piece)
    return data[:at] + piece + data[at + len(piece) :]


def _count(data: bytes, rng: Random) -> bytes:
    """Change a number of 4 or 8 bytes by a little."""
    form = rng.choice(("<I", "<Q"))
    size = struct.calcsize(form)
    if len(data) < size:
        return data
    at = rng.randrange(len(data) - size + 1) // 4 * 4
    number = struct.unpack_from(form, data, at)[0] + rng.choice((-8, -1, 1, 2, 16, 1 << 20))
    return data[:at] + struct.pack(form, number % (1 << 8 * size)) + data[at + size :]


def _cut(data: bytes, rng: Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _drop(data: bytes, rng: Random) -> bytes:
    start, stop = _span(len(data), rng)
    return data[:start] + data[stop:]


def _repeat(data: bytes, rng: Random) -> bytes:
    start, stop = _span(len(data), rng)
    return data[:stop] + data[start:stop] * rng.choice((1, 1, 2, 20)) + data[stop:]


def _copy(data: bytes, rng: Random) -> bytes:
    """Overwrite with what is elsewhere."""
    start, stop = _span(len(data), rng, 64)
    at = rng.randrange(len(data) + 1)
    return data[:at] + data[start:stop] + data[at + stop - start :]


def _scrap(data: bytes, rng: Random) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.choice(SCRAPS) + data[at + rng.randrange(2) :]


_BYTE_STEPS: tuple[Callable[[bytes, Random], bytes], ...] = (
    _flip,
    _flip,
    _pattern,
    _pattern,
    _count,
    _copy,
    _cut,
    _drop,
    _repeat,
    _scrap,
)


def _tokens(data: bytes) -> list[bytes]:
    return TOKEN.findall(data)


def _some(tokens: list[bytes], rng: Random, begins: bytes) -> int | None:
    """Choose one of the tokens that begin with one of some bytes."""
    places = [i for i, token in enumerate(tokens) if token[0] in begins]
    return rng.choice(places) if places else None


def _number(data: bytes, rng: Random, words: Sequence[bytes]) -> bytes:
    tokens = _tokens(data)
    at = _some(tokens, rng, DIGITS)
    if at is not None:
        numbers = NUMBERS if rng.random() < 0.8 else ODD_NUMBERS
        tokens[at] = rng.choice(numbers)
    return b"".join(tokens)


def _word(data: bytes, rng: Random, words: Sequence[bytes]) -> bytes:
    """Exchange a word, a path or a string for another, mostly for one of its sort."""
    tokens = _tokens(data)
    at = _some(tokens, rng, LETTERS + DIGITS + QUOTES)
    if at is not None:
        known = words if rng.random() < 0.6 else tokens
        first = tokens[at][:1]
        sort = first if first in QUOTES else LETTERS
        if rng.random() < 0.2:
            sort = VISIBLE
        fit = [token for token in known if token[0] in sort]
        tokens[at] = rng.choice(fit or known)
    return b"".join(tokens)


def _insert(data: bytes, rng: Random, words: Sequence[bytes]) -> bytes:
    tokens = _tokens(data)
    tokens.insert(rng.randrange(len(tokens) + 1), b" " + rng.choice(words) + b" ")
    return b"".join(tokens)


def _remove(data: bytes, rng: Random, words: Sequence[bytes]) -> bytes:
    tokens = _tokens(data)
    at = _some(tokens, rng, VISIBLE)
    if at is not None:
        del tokens[at : at + rng.choice((1, 1, 1, 3, 10))]
    return b"".join(tokens)


def _lengthen(data: bytes, rng: Random, words: Sequence[bytes]) -> bytes:
    tokens = _tokens(data)
    at = _some(tokens, rng, LETTERS + DIGITS)
    if at is not None:
        times = rng.choice((2, 300, LONG))
        tokens[at] *= min(times, max(1, LONGEST // len(tokens[at])))
    return b"".join(tokens)


def _lines(data: bytes, rng: Random, words: Sequence[bytes]) -> bytes:
    """Remove, repeat or exchange lines."""
    lines = data.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            del lines[i]
        case 1:
            lines.insert(j, lines[i])
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case _:
            lines[i:i] = lines[min(i, j) : max(i, j)] * rng.choice((1, 3))
    return b"\n".join(lines)


_TEXT_STEPS: tuple[Callable[[bytes, Random, Sequence[bytes]], bytes], ...] = (
    _number,
    _number,
    _number,
    _word,
    _word,
    _word,
    _insert,
    _remove,
    _lengthen,
    _lines,
    _lines,
)
