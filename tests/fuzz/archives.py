"""Alters what zip files hold, and zip files themselves: .usdz packages and files of evidence."""

from __future__ import annotations

import io
import json
import math
import warnings
import zipfile
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

from .texts import LONG, NUMBERS, altered_bytes, altered_text

ALIGNMENT = 64
HEADER = 30
Members = list[tuple[str, bytes]]


def unpacked(data: bytes) -> Members:
    """Return the names and contents of a zip file."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return [(name, archive.read(name)) for name in archive.namelist()]


def packed(members: Members, *, method: int = zipfile.ZIP_STORED, aligned: bool = True) -> bytes:
    """Make a zip file; `aligned` as .usdz packages have to be."""
    buffer = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(buffer, "w", method) as archive:
        # It warns of names that are there twice, which is meant.
        warnings.simplefilter("ignore")
        for name, content in members:
            info = zipfile.ZipInfo(name)
            info.compress_type = method
            if aligned:
                gap = -(buffer.tell() + HEADER + len(name.encode())) % ALIGNMENT
                gap += ALIGNMENT if 0 < gap < 4 else 0
                if gap:
                    info.extra = b"\x86\x19" + (gap - 4).to_bytes(2, "little") + bytes(gap - 4)
            archive.writestr(info, content)
    return buffer.getvalue()


def altered_members(
    members: Members, rng: Random, names: Sequence[str], alter: Callable[[str, bytes], bytes]
) -> Members:
    """Alter a member by `alter(name, content)`, or drop, repeat, rename or exchange members."""
    members = list(members)
    i, j = rng.randrange(len(members)), rng.randrange(len(members))
    name, content = members[i]
    match rng.randrange(12):
        case 0:
            del members[i]
        case 1:
            members.insert(j, members[i])
        case 2 | 3:
            members[i] = (rng.choice(names), content)
        case 4:
            members[i], members[j] = members[j], members[i]
        case 5:
            members.insert(i, (rng.choice(names), content))
        case 6:
            members[i] = (name, members[j][1])
        case _:
            members[i] = (name, alter(name, content))
    return members


def altered_archive(data: bytes, rng: Random) -> bytes:
    """Alter the directory of a zip file, or a header in it."""
    where = [i for i in range(len(data)) if data.startswith((b"PK\1\2", b"PK\3\4", b"PK\5\6"), i)]
    at = rng.choice(where)
    return data[:at] + altered_bytes(data[at : at + 64], rng) + data[at + 64 :]


def altered_json(value: Any, rng: Random) -> Any:
    """Alter one value of a JSON document, of any depth."""
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = rng.choice(list(value))
        match rng.randrange(12):
            case 0:
                return {k: v for k, v in value.items() if k != key}
            case 1:
                return {**value, rng.choice([*value, "", "x" * LONG]): value[key]}
            case _:
                return {**value, key: altered_json(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.9:
        i = rng.randrange(len(value))
        match rng.randrange(8):
            case 0:
                return value[:i] + value[i + 1 :]
            case 1:
                return value[:i] + [value[i]] * rng.choice((2, 100)) + value[i:]
            case _:
                return [*value[:i], altered_json(value[i], rng), *value[i + 1 :]]
    return _other_value(value, rng)


def json_text(value: Any, rng: Random) -> bytes:
    """Spell a JSON document, now and then with errors in its text."""
    text = json.dumps(value).encode("utf-8", "surrogatepass")
    return (
        altered_text(text, rng, [b"NaN", b"1e999", b"{}", b"[", b'"\\ud800"'])
        if (rng.random() < 0.1)
        else text
    )


def _other_value(value: Any, rng: Random) -> Any:
    if isinstance(value, str) and rng.random() < 0.5:
        return altered_text(value.encode(), rng, [b"/", b"..", b"apex"]).decode(errors="replace")
    if isinstance(value, int | float) and rng.random() < 0.6:
        shift = rng.choice((1, -1, 0.5, 1000, -value, 1e18))
        return value + shift if rng.random() < 0.5 else int(value + shift)
    deep: Any = []
    for _ in range(200):
        deep = [deep]
    return rng.choice(
        [
            *(None, True, False, 0, -1, 1, 2**31, 2**63, -(2**63), 10**40, 0.1, 1e308, 1e-320),
            *(math.nan, math.inf, "", "\0", "\ud800", "\n", "x" * LONG, "../../x", "/"),
            *([], {}, [[]], [None], {"a": 1}, deep),
            *(word.decode() for word in NUMBERS),
        ]
    )
