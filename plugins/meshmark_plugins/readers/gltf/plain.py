"""The same glTF file without compression: plain arrays of floats and indices in one buffer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.errors import InputError, UsageError
from meshmark_plugins.readers.gltf.accessors import Accessors, stored_type
from meshmark_plugins.readers.gltf.buffers import Buffers
from meshmark_plugins.readers.gltf.container import Container, copied
from meshmark_plugins.readers.gltf.draco import EXTENSION as DRACO
from meshmark_plugins.readers.gltf.draco import draco_mesh, not_installed
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.geometry import POSITION, TRIANGLES
from meshmark_plugins.readers.gltf.meshopt import EXTENSIONS as MESHOPT

QUANTIZATION = "KHR_mesh_quantization"
FLOAT, UNSIGNED = 5126, 5125
# What glTF itself has as floats only, and what it has as floats or integers that stand for them.
FLOATS, TEXTURE = (POSITION, "NORMAL", "TANGENT"), "TEXCOORD_"
NORMALIZED = ("u1", "u2")
ALIGNED = 4
# What a view is for.
VERTICES, INDICES = 34962, 34963


def uncompressed(container: Container, folder: Path) -> Container:
    """Return a document without compressed, quantised or sparse vertices, and its only buffer.

    Accessors keep their numbers. Views that nothing uses any more are left out.

    Raises
    ------
    InputError
        If something cannot be decoded.
    UsageError
        If primitives that are compressed separately share an accessor.
    """
    plain = _Plain(container, folder)
    for mesh in container.root.objects("meshes"):
        for primitive in mesh.objects("primitives"):
            plain.unpack(primitive)
    for mesh in container.root.objects("meshes"):
        for primitive in mesh.objects("primitives"):
            plain.unquantise(primitive)
    root, binary = plain.finished()
    return Container(Element(root), memoryview(binary), container.others)


class _Plain:
    """A document that becomes plain, one primitive after the other."""

    def __init__(self, container: Container, folder: Path) -> None:
        self.root = copied(container.root.members)
        self._buffers = Buffers(container, folder)
        self._accessors = Accessors(container.root, self._buffers)
        self._data = [bytearray(self._buffers.view(i)) for i in range(len(self._buffers.views))]
        for view in self.root.get("bufferViews", ()):
            _without(view, *MESHOPT)
        self._decoded: dict[int, str] = {}
        self._converted: set[int] = set()

    def unpack(self, primitive: Element) -> None:
        """Put what Draco compressed of a primitive into accessors."""
        extension = primitive.extension(DRACO)
        if extension is None:
            return
        view = extension.index("bufferView", self._buffers.views)
        found = draco_mesh(extension, self._buffers.view(view))
        if found is None:
            raise not_installed(extension)
        attributes = primitive.object("attributes")
        for name, stored in found.attributes.items():
            if name not in attributes:
                continue
            index = attributes.index(name, self._accessors.elements)
            self._claim(index, extension)
            width = self._accessors.width(index)
            values = self._accessors.values(index, width, stored=stored)
            odd = self._odd(index, name)
            kind = np.dtype("<f4") if odd else stored_type(self._accessors.elements[index])
            if odd:
                values = self._accessors.numbers(index, width, stored=stored)
            self._put(index, values.astype(kind))
        faces = primitive.optional_index("indices", self._accessors.elements)
        twin = _twin(self.root, primitive)
        if faces is None:
            faces = twin["indices"] = len(self.root["accessors"])
            self.root["accessors"].append({})
        else:
            self._claim(faces, extension)
        twin["mode"] = TRIANGLES
        _without(twin, DRACO)
        self.root["accessors"][faces] |= {"type": "SCALAR", "componentType": UNSIGNED}
        self._put(faces, found.faces.reshape(-1, 1).astype("<u4"))

    def unquantise(self, primitive: Element) -> None:
        """Put the vertices of a primitive, and of its morph targets, into accessors of floats."""
        known = self._accessors.elements
        base = primitive.object("attributes")
        n = self._accessors.count(base.index(POSITION, known))
        for attributes in (base, *primitive.objects("targets")):
            for name in attributes.members:
                index = attributes.index(name, known)
                sparse = name == POSITION and attributes is base and "sparse" in known[index]
                if index not in self._converted and (sparse or self._odd(index, name)):
                    width = self._accessors.width(index)
                    # What positions do not list is nothing to be made up.
                    count = None if attributes is base and name == POSITION else n
                    self._put(index, self._accessors.numbers(index, width, count=count))

    def finished(self) -> tuple[dict[str, Any], bytes]:
        """Return the document, and the buffer of all that it uses."""
        self._clear()
        for kind in ("extensionsUsed", "extensionsRequired"):
            gone = (*MESHOPT, DRACO, QUANTIZATION)
            named = self.root.pop(kind, ())
            left = [name for name in named if name not in gone] if type(named) is list else []
            self.root |= {kind: left} if left else {}
        holders = list(_holders(self.root, len(self._data)))
        used = sorted({holder["bufferView"] for holder in holders})
        number = {old: new for new, old in enumerate(used)}
        for holder in holders:
            holder["bufferView"] = number[holder["bufferView"]]
        views, binary = [], bytearray()
        for old in used:
            binary += b"\0" * (-len(binary) % ALIGNED)
            view = {**self.root["bufferViews"][old], "buffer": 0, "byteOffset": len(binary)}
            views.append(view | {"byteLength": len(self._data[old])})
            binary += self._data[old]
        self.root |= {"bufferViews": views, "buffers": [{"byteLength": len(binary)}]}
        return self.root, bytes(binary)

    def _odd(self, index: int, name: str) -> bool:
        """Tell whether an accessor is not as glTF has it without extensions."""
        accessor = self._accessors.elements[index]
        kind = stored_type(accessor)
        if name in FLOATS:
            return kind.kind != "f"
        if not name.startswith(TEXTURE) or kind.kind == "f":
            return False
        return not (accessor.flag("normalized") and kind.str[1:] in NORMALIZED)

    def _claim(self, index: int, extension: Element) -> None:
        """Refuse an accessor that is to hold what is compressed in another place, too."""
        whose = repr(extension.members)
        if self._decoded.setdefault(index, whose) != whose:
            raise UsageError(f"accessors[{index}] is shared by compressed primitives")

    def _put(self, index: int, values: NDArray[Any]) -> None:
        """Give an accessor a view of its own, and leave nothing of what it had."""
        accessor = self.root["accessors"][index]
        accessor |= {"bufferView": len(self._data), "count": len(values)}
        for name in ("byteOffset", "sparse", "min", "max"):
            accessor.pop(name, None)
        if values.dtype.kind == "f":
            values = values.astype("<f4")
            accessor["componentType"] = FLOAT
            accessor.pop("normalized", None)
        size = values.shape[1] * values.dtype.itemsize
        padded = np.zeros((len(values), size + -size % ALIGNED), np.uint8)
        padded[:, :size] = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), size)
        view: dict[str, Any] = {"target": VERTICES}
        if accessor["type"] == "SCALAR":
            padded, view["target"] = padded[:, :size], INDICES
        elif padded.shape[1] > size:
            view["byteStride"] = padded.shape[1]
        self.root.setdefault("bufferViews", []).append(view)
        self._data.append(bytearray(padded.tobytes()))
        if values.dtype.kind == "f" and np.isfinite(values).all():
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self._converted.add(index)

    def _clear(self) -> None:
        """Remove from their former views the numbers of accessors that have views of their own."""
        for index in range(len(self._accessors.elements)):
            if index in self._converted:
                for rows in self._accessors.rows(index):
                    rows.of(self._data[rows.within[1]])[:] = 0
        # What others use stays.
        for index in range(len(self._accessors.elements)):
            with suppress(InputError):
                if index not in self._converted:
                    for rows in self._accessors.rows(index):
                        number = rows.within[1]
                        rows.of(self._data[number])[:] = rows.of(self._buffers.view(number))


def _twin(root: Mapping[str, Any], primitive: Element) -> dict[str, Any]:
    """Return the primitive of a copy that is at the same place."""
    mesh, number = (int(part.partition("]")[0]) for part in primitive.place.split("[")[1:])
    return root["meshes"][mesh]["primitives"][number]


def _without(holder: dict[str, Any], *names: str) -> None:
    extensions = holder.get("extensions", {})
    for name in names:
        extensions.pop(name, None)
    if not extensions:
        holder.pop("extensions", None)


def _holders(root: dict[str, Any], n: int) -> Iterator[dict[str, Any]]:
    """Go through all objects that name one of `n` views, wherever in a document they are."""
    waiting: list[Any] = [root]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            view = value.get("bufferView")
            if type(view) is int and 0 <= view < n:
                yield value
            waiting += value.values()
        elif isinstance(value, list):
            waiting += value
