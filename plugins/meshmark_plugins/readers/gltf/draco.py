"""Primitives that were compressed by Draco."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import IntArray
from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.extra import missing

EXTENSION = "KHR_draco_mesh_compression"
MAGIC, BITSTREAM = b"DRACO", (2, 2)
MESH, SEQUENTIAL = 1, 0
HAS_METADATA = 0x8000
# Regular triangles cost next to nothing, but what is around them does.
MOST_FACES_PER_BYTE = 1000


@dataclass(frozen=True, eq=False)
class DracoMesh:
    """What was compressed of a primitive.

    Parameters
    ----------
    faces : (F, 3) int
        Triangles, whether it was a strip before or not.
    attributes : mapping of str to (N, C) array
        By their names in glTF, in their stored types.
    """

    faces: IntArray
    attributes: Mapping[str, NDArray[Any]]


def draco_mesh(extension: Element, data: memoryview) -> DracoMesh | None:
    """Decode a primitive.

    Parameters
    ----------
    extension : Element
        Of the primitive.
    data : memoryview
        The bytes of the extension's view.

    Returns
    -------
    DracoMesh or None
        None if the decoder is not installed.

    Raises
    ------
    InputError
        If the data is malformed, or claims more than it can hold.

    References
    ----------
    Khronos Group, glTF extension KHR_draco_mesh_compression; Google, Draco Bitstream
    Specification 2.2.
    """
    _require_fit(extension, data)
    try:
        import DracoPy
    except ImportError:
        return None
    try:
        found = DracoPy.decode(bytes(data))
    except (ValueError, RuntimeError, DracoPy.FileTypeException) as error:
        raise InputError(f"{extension.place} cannot be decoded: {error}") from None
    stored = {each["unique_id"]: np.asarray(each["data"]) for each in found.attributes}
    names = extension.object("attributes")
    attributes = {}
    for name in names.members:
        number = names.integer(name)
        if number not in stored:
            names.fail(name, f"is {number}, an attribute that the compressed data does not hold")
        attributes[name] = stored[number]
    return DracoMesh(np.asarray(found.faces, dtype=np.int64).reshape(-1, 3), attributes)


def not_installed(extension: Element) -> InputError:
    """Return the error of a primitive that cannot be decoded here."""
    return missing(extension.place, "Draco", "DracoPy")


def _require_fit(extension: Element, data: memoryview) -> None:
    """Look at the header before anything is allocated for what it claims."""
    header = bytes(data[:64])
    if not header.startswith(MAGIC) or len(header) < 12:
        raise InputError(f"{extension.place} is not compressed by Draco")
    version, kind, method = (header[5], header[6]), header[7], header[8]
    if version != BITSTREAM or kind != MESH:
        what = f"Draco data of version {version[0]}.{version[1]} and kind {kind}"
        raise InputError(f"{extension.place} is {what}; only meshes of version 2.2 are read")
    if int.from_bytes(header[9:11], "little") & HAS_METADATA:
        raise InputError(f"{extension.place} holds Draco metadata, which is not read")
    # Connectivity begins with two sizes; one of them is the number of faces.
    place = 11 if method == SEQUENTIAL else 12
    first, place = _varint(header, place)
    second, _ = _varint(header, place)
    if max(first, second) > MOST_FACES_PER_BYTE * len(data):
        claim = f"claims {first} and {second} faces and points"
        raise InputError(f"{extension.place} {claim}: more than {len(data)} bytes can hold")


def _varint(data: bytes, place: int) -> tuple[int, int]:
    """Read a number of seven bits a byte, lowest first; return it, and where it ends."""
    value = shift = 0
    while place < len(data):
        byte = data[place]
        value |= (byte & 0x7F) << shift
        place, shift = place + 1, shift + 7
        if byte < 0x80:
            break
    return value, place
