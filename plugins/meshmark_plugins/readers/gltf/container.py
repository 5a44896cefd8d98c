"""The two forms of a glTF file: binary with chunks, and JSON text."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from meshmark.errors import InputError, OutputError
from meshmark.files.reading import opened
from meshmark_plugins.readers.gltf.element import Element

MAGIC, VERSION = b"glTF", 2
HEADER, CHUNK_HEADER = struct.Struct("<4sII"), struct.Struct("<II")
JSON, BINARY = 0x4E4F534A, 0x004E4942
BINARY_SUFFIX, TEXT_SUFFIX = ".glb", ".gltf"
LARGEST_BINARY = (1 << 32) - 1


@dataclass(frozen=True)
class Container:
    """What a glTF file holds.

    Parameters
    ----------
    root : Element
        The JSON document.
    binary : memoryview or None
        The binary chunk, if there is one.
    others : tuple of (int, memoryview)
        Chunks of other kinds: kind and content.
    """

    root: Element
    binary: memoryview | None
    others: tuple[tuple[int, memoryview], ...] = ()


def read_container(path: Path) -> Container:
    """Read a file of either form; what it is called does not matter if it begins with the magic.

    Raises
    ------
    InputError
        If it cannot be read, is cut short, or is not of version 2.

    References
    ----------
    Khronos Group, glTF 2.0 Specification, section 4: GLB File Format Specification.
    """
    with opened(path) as file:
        data = file.read()
    if data.startswith(MAGIC):
        text, binary, others = _chunks(data)
    elif path.suffix.lower() == BINARY_SUFFIX:
        raise InputError("is not a binary glTF file: it does not begin with 'glTF'")
    else:
        text, binary, others = memoryview(data), None, ()
    root = Element(_parsed(text))
    version = root.object("asset").text("version")
    if version.split(".")[0] != str(VERSION):
        root.object("asset").fail("version", f"is {version[:8]!r}; only 2.x is read")
    return Container(root, binary, others)


Chunks = tuple[tuple[int, memoryview], ...]


def _chunks(data: bytes) -> tuple[memoryview, memoryview | None, Chunks]:
    """Return the JSON, the binary chunk, and those of other kinds."""
    found: dict[int, memoryview] = {}
    others: list[tuple[int, memoryview]] = []
    for kind, chunk in _each_chunk(data):
        if not found and kind != JSON:
            raise InputError("its first chunk is not JSON")
        if kind in found and kind in (JSON, BINARY):
            what = "JSON" if kind == JSON else "binary data"
            raise InputError(f"its chunk of {what} is there a second time")
        found[kind] = chunk
        others += [] if kind in (JSON, BINARY) else [(kind, chunk)]
    if JSON not in found:
        raise InputError("holds no chunk of JSON")
    return found[JSON], found.get(BINARY), tuple(others)


def _each_chunk(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """Go through the chunks of a binary file: kind and content."""
    if len(data) < HEADER.size:
        raise InputError("ends within its header")
    _, version, length = HEADER.unpack_from(data)
    if version != VERSION:
        raise InputError(f"is binary glTF of version {version}; only version {VERSION} is read")
    if length > len(data):
        raise InputError(f"is cut short: it has {len(data)} bytes and should have {length}")
    whole = memoryview(data)[:length]
    begin = HEADER.size
    while begin < length:
        if begin + CHUNK_HEADER.size > length:
            raise InputError(f"ends within the chunk header at byte {begin}")
        size, kind = CHUNK_HEADER.unpack_from(whole, begin)
        body = begin + CHUNK_HEADER.size
        if body + size > length:
            raise InputError(f"the chunk at byte {begin} reaches beyond the end of the file")
        yield kind, whole[body : body + size]
        begin = body + size


def binary_form(
    text: bytes, binary: bytes | None, others: Sequence[tuple[int, memoryview]] = ()
) -> bytes:
    """Put a document and its binary data into one file, then chunks of other kinds.

    Raises
    ------
    OutputError
        If it has more bytes than the format can count.
    """
    chunks = [(JSON, text + b" " * (-len(text) % 4))]
    chunks += [] if binary is None else [(BINARY, binary + b"\0" * (-len(binary) % 4))]
    chunks += [(kind, bytes(chunk)) for kind, chunk in others]
    body = b"".join(CHUNK_HEADER.pack(len(chunk), kind) + chunk for kind, chunk in chunks)
    if HEADER.size + len(body) > LARGEST_BINARY:
        raise OutputError("would have more than 4 GB, which binary glTF cannot")
    return HEADER.pack(MAGIC, VERSION, HEADER.size + len(body)) + body


def spelled(root: Mapping[str, Any], indent: int | None = None) -> bytes:
    """Return the JSON text of a document.

    Raises
    ------
    InputError
        If it is nested more deeply than can be written, or holds a number that is too large.
    """
    try:
        return json.dumps(
            root, indent=indent, separators=(",", ": " if indent else ":"), allow_nan=False
        ).encode("ascii")
    except RecursionError:
        raise InputError("its JSON is nested too deeply") from None
    except ValueError:
        raise InputError("its JSON holds a number beyond the range of float64") from None


def copied(root: Mapping[str, Any]) -> dict[str, Any]:
    """Return a document that can be changed."""
    return _parsed(memoryview(spelled(root)))


def _parsed(text: memoryview) -> dict[str, Any]:
    try:
        document = DECODER.decode(str(text, "utf-8-sig"))
    except UnicodeDecodeError as error:
        raise InputError(f"its JSON is not UTF-8 at byte {error.start}") from None
    except RecursionError:
        raise InputError("its JSON is nested too deeply") from None
    except json.JSONDecodeError as error:
        message = f"its JSON is wrong in line {error.lineno}, column {error.colno}: {error.msg}"
        raise InputError(message) from None
    except ValueError as error:
        raise InputError(f"its JSON is wrong: {error}") from None
    if not isinstance(document, dict):
        raise InputError("its JSON is not an object")
    return document


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not a number of JSON")


DECODER = json.JSONDecoder(parse_constant=_no_constant)
