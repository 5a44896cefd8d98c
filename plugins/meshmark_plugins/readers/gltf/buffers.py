"""The bytes of a glTF file: buffers within it and beside it, and views of them."""

from __future__ import annotations

import os
from pathlib import Path

from meshmark.errors import InputError
from meshmark.files.reading import opened
from meshmark_plugins.readers.gltf.container import Container
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.meshopt import EXTENSIONS as MESHOPT
from meshmark_plugins.readers.gltf.meshopt import decompressed
from meshmark_plugins.readers.gltf.uris import embedded, file_beside


class Buffers:
    """Views of buffers, each read and decompressed once, when it is asked for.

    Parameters
    ----------
    container : Container
        The document, and the binary chunk.
    folder : Path
        Where the files of other buffers are.
    """

    def __init__(self, container: Container, folder: Path) -> None:
        self.views = container.root.objects("bufferViews")
        self._buffers = container.root.objects("buffers")
        self._binary = container.binary
        self._folder = folder
        self._read: dict[int, memoryview] = {}
        self._views: dict[int, memoryview] = {}
        self._strides: dict[int, int | None] = {}

    def view(self, index: int) -> memoryview:
        """Return the bytes of a view, decompressed.

        Raises
        ------
        InputError
            If it reaches beyond its buffer, or that cannot be read.
        """
        if index not in self._views:
            self._views[index] = self._view(self.views[index])
        return self._views[index]

    def data(self, index: int) -> memoryview | None:
        """Return the bytes of a buffer; None if there are none, as of one for old readers only."""
        has_none = "uri" not in self._buffers[index] and (index > 0 or self._binary is None)
        return None if has_none else self._buffer(index)

    def stride(self, index: int) -> int | None:
        """Return how far apart the elements of a view are, in bytes; None if they are dense."""
        if index not in self._strides:
            view = self.views[index]
            told = "byteStride" in view
            self._strides[index] = view.integer("byteStride", low=1, high=1 << 16) if told else None
        return self._strides[index]

    def _view(self, view: Element) -> memoryview:
        packed = view.extension(*MESHOPT)
        if packed is None:
            return self._slice(view)
        length = view.integer("byteLength")
        return decompressed(packed, self._slice(packed), length, lambda: self._slice(view))

    def _slice(self, view: Element) -> memoryview:
        buffer = self._buffer(view.index("buffer", self._buffers))
        begin, length = view.integer("byteOffset", default=0), view.integer("byteLength")
        if begin + length > len(buffer):
            message = f"is {length} from {begin} on, but the buffer has {len(buffer)} bytes"
            view.fail("byteLength", message)
        return buffer[begin : begin + length]

    def _buffer(self, index: int) -> memoryview:
        if index not in self._read:
            self._read[index] = self._load(index)
        return self._read[index]

    def _load(self, index: int) -> memoryview:
        buffer = self._buffers[index]
        length = buffer.integer("byteLength")
        if "uri" not in buffer:
            if index or self._binary is None:
                buffer.fail("uri", "is missing, and there is no binary chunk for it")
            data = self._binary
        else:
            try:
                data = self._from_uri(buffer.text("uri"), length)
            except InputError as error:
                buffer.fail("uri", error.message)
        if len(data) < length:
            buffer.fail("byteLength", f"is {length}, but there are {len(data)} bytes")
        return data[:length]

    def _from_uri(self, uri: str, length: int) -> memoryview:
        data = embedded(uri)
        if data is not None:
            return memoryview(data)
        path = file_beside(uri, self._folder)
        try:
            with opened(path) as file:
                # No more than there is: a file may claim any length.
                size = os.fstat(file.fileno()).st_size
                return memoryview(file.read(min(length, size)))
        except InputError as error:
            raise InputError(f"names {path.name!r}, which {error.message}") from None
