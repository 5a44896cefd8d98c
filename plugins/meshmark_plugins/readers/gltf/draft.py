"""The bytes of a glTF file while they are changed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from meshmark.errors import UsageError
from meshmark_plugins.readers.gltf.buffers import Buffers
from meshmark_plugins.readers.gltf.container import Container, copied
from meshmark_plugins.readers.gltf.meshopt import EXTENSIONS as MESHOPT
from meshmark_plugins.readers.gltf.meshopt import compressed
from meshmark_plugins.readers.gltf.rows import BUFFERS, VIEWS, Rows


class Draft:
    """A document, its buffers, and its compressed views, to be changed.

    Parameters
    ----------
    container : Container
        What it is made from, which stays as it is.
    folder : Path
        Where the files of its buffers are.
    """

    def __init__(self, container: Container, folder: Path) -> None:
        self.root = copied(container.root.members)
        self._buffers = Buffers(container, folder)
        self._changing: dict[tuple[str, int], bytearray] = {}

    def of(self, rows: Rows) -> NDArray[Any]:
        """Return rows to be read and written, (count, width)."""
        kind, index = rows.within
        if rows.within not in self._changing:
            data = self._buffers.view(index) if kind == VIEWS else self._buffers.data(index)
            self._changing[rows.within] = bytearray(data or b"")
        return rows.of(self._changing[rows.within])

    def data(self) -> dict[int, bytes]:
        """Return the buffers that have data, as they are now, with compressed views in them.

        The document then says where in them everything is.

        Raises
        ------
        UsageError
            If a compressed view needs more room than it had, and shares it with others.
        """
        found = {
            index: self._now(index)
            for index in range(len(self.root.get(BUFFERS, ())))
            if self._buffers.data(index) is not None
        }
        for kind, index in list(self._changing):
            if kind == VIEWS:
                self._compress(index, found)
        for index, data in found.items():
            self.root[BUFFERS][index]["byteLength"] = len(data)
        return found

    def _now(self, index: int) -> bytes:
        return bytes(self._changing.get((BUFFERS, index)) or self._buffers.data(index) or b"")

    def _compress(self, index: int, buffers: dict[int, bytes]) -> None:
        """Put a view back to where it was, compressed; and what is there for all readers, too."""
        view, data = self.root[VIEWS][index], bytes(self._changing[VIEWS, index])
        packed = next(view["extensions"][name] for name in MESHOPT if name in view["extensions"])
        end = view.get("byteOffset", 0) + len(data)
        if end <= len(buffers.get(view["buffer"], b"")):
            self._replace(view, data, buffers)
        # The values of filters are written as they are.
        packed.pop("filter", None)
        self._replace(packed, compressed(data, packed["byteStride"]), buffers)

    def _replace(self, there: dict[str, Any], data: bytes, buffers: dict[int, bytes]) -> None:
        """Put other bytes in the place of some; what is behind them is moved if they are more."""
        old, begin = buffers[there["buffer"]], there.get("byteOffset", 0)
        end = begin + there["byteLength"]
        more = max(0, len(data) - there["byteLength"])
        more += -more % 4
        for each in _slices(self.root):
            if each is there or each.get("buffer") != there["buffer"]:
                continue
            its_begin = each.get("byteOffset", 0)
            if its_begin >= end:
                each["byteOffset"] = its_begin + more
            elif its_begin + each["byteLength"] > begin:
                raise UsageError("compressed views share bytes, so they are not written back")
        there["byteLength"] = len(data)
        # Nothing of what was there stays.
        room = data.ljust(end - begin + more, b"\0")
        buffers[there["buffer"]] = old[:begin] + room + old[end:]


def _slices(root: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Go through all that says which bytes of a buffer it is."""
    for view in root.get(VIEWS, ()):
        yield view
        for name in MESHOPT:
            if name in view.get("extensions", {}):
                yield view["extensions"][name]
