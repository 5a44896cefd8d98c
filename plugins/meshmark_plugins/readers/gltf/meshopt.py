"""Views of buffers that were compressed by meshoptimizer."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.extra import missing

EXTENSIONS = ("EXT_meshopt_compression", "KHR_meshopt_compression")
MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
FILTERS = ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR")

# What a byte can stand for at most, in bytes: a block of 8 kB, or of 256 rows of four bytes, has a
# byte of control for each four bytes of a row. Triangles and indices take a byte each.
MOST_PER_BYTE = {"ATTRIBUTES": 1024, "TRIANGLES": 12, "INDICES": 4}


def decompressed(
    packed: Element, data: memoryview, length: int, fallback: Callable[[], memoryview]
) -> memoryview:
    """Decode the bytes of a view.

    Parameters
    ----------
    packed : Element
        The extension of the view.
    data : memoryview
        What the extension's own view holds.
    length : int
        Bytes of the view.
    fallback : callable
        Returns the bytes that are there for readers that cannot decode.

    Raises
    ------
    InputError
        If the data is malformed, claims more than it can hold, or cannot be decoded here.

    References
    ----------
    Khronos Group, glTF extensions EXT_meshopt_compression and KHR_meshopt_compression.
    """
    mode = packed.one_of("mode", MODES)
    kind = packed.one_of("filter", FILTERS, "NONE")
    count = packed.integer("count")
    stride = packed.integer("byteStride", low=1, high=256)
    if count * stride != length:
        packed.fail("count", f"is {count}, of {stride} bytes each, but the view has {length} bytes")
    # The decoder allocates what it is asked for.
    if length > MOST_PER_BYTE[mode] * len(data):
        packed.fail("count", f"is {count}: more than {len(data)} compressed bytes can hold")
    try:
        from meshopt import decode_gltf_buffer
    except ImportError:
        return _plain(packed, fallback)
    try:
        found = decode_gltf_buffer(bytes(data), count, stride, mode, kind)
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{packed.place} cannot be decoded: {error}") from None
    return memoryview(found.reshape(-1).view("u1"))


def _plain(packed: Element, fallback: Callable[[], memoryview]) -> memoryview:
    try:
        return fallback()
    except InputError:
        raise missing(packed.place, "meshoptimizer", "meshopt") from None


def compressed(data: bytes, stride: int) -> bytes:
    """Encode rows of a view of attributes.

    Parameters
    ----------
    data : bytes
        Some rows.
    stride : int
        Bytes of a row, see `writable`.
    """
    from meshopt import encode_gltf_buffer

    rows = np.frombuffer(data, np.uint8).reshape(-1, stride)
    return bytes(encode_gltf_buffer(rows, "ATTRIBUTES"))


def writable(view: Element, packed: Element) -> bool:
    """Tell whether a view can be encoded again: once, of attributes, and of sound size.

    Its count and stride were compared with its length when it was decoded.

    Raises
    ------
    InputError
        If the encoder is not installed.
    """
    try:
        import meshopt  # noqa: F401
    except ImportError:
        raise missing(packed.place, "meshoptimizer", "meshopt") from None
    once = sum(name in view.object("extensions") for name in EXTENSIONS) == 1
    stride = packed.integer("byteStride", low=1, high=256)
    return once and packed.one_of("mode", MODES) == "ATTRIBUTES" and stride % 4 == 0
