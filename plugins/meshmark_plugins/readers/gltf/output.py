"""Puts a glTF document and its buffers in place: in one file, or in several."""

from __future__ import annotations

import binascii
import os
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import quote

from meshmark.files.atomic import beside
from meshmark.files.places import data_file
from meshmark_plugins.readers.gltf.container import (
    BINARY_SUFFIX,
    Container,
    binary_form,
    spelled,
)
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.uris import any_file, embedded_head

INDENT = 1


def write_document(
    container: Container,
    root: dict[str, Any],
    data: Mapping[int, bytes],
    folder: Path,
    output: Path,
) -> None:
    """Write a document in the form that the output's name says, with its buffers.

    The first buffer of a .glb is its binary chunk. Others stay in the document if they are in it,
    and are files beside the output if they are files. Images stay where they are.

    Parameters
    ----------
    container : Container
        What the document was made from.
    root : dict
        The document, which is changed to say where its buffers are.
    data : mapping of int to bytes
        The buffers that have data.
    folder : Path
        Where the files are that the document names.
    output : Path

    Raises
    ------
    OutputError
        If a file cannot be written.
    """
    binary = output.suffix.lower() == BINARY_SUFFIX
    files: dict[Path, bytes] = {}
    chunk: bytes | None = None
    for index, content in data.items():
        buffer = root["buffers"][index]
        head = embedded_head(buffer.get("uri", ""))
        if binary and index == 0:
            chunk = content
            buffer.pop("uri", None)
        elif head is not None:
            buffer["uri"] = head + binascii.b2a_base64(content, newline=False).decode("ascii")
        else:
            path = data_file(output, index)
            files[path] = content
            buffer["uri"] = quote(path.name)
    _keep_images(root, folder, output.parent)
    text = spelled(root, None if binary else INDENT)
    files[output] = binary_form(text, chunk, container.others) if binary else text
    _put_in_place(files)


def _put_in_place(files: Mapping[Path, bytes]) -> None:
    """Write files, and put them where they belong when all are written."""
    with ExitStack() as stack:
        places = {path: stack.enter_context(beside(path)) for path in files}
        for path, content in files.items():
            places[path].write_bytes(content)
        for path, place in places.items():
            place.replace(path)


def files_beside(output: Path, root: Element) -> list[Path]:
    """List the files that `write_document` may write beside an output."""
    return [data_file(output, index) for index in range(len(root.objects("buffers")))]


def _keep_images(root: dict[str, Any], folder: Path, place: Path) -> None:
    """Let images be found from another folder."""
    if os.path.realpath(folder) == os.path.realpath(place):
        return
    for image in root.get("images", ()):
        path = any_file(image.get("uri", ""), folder)
        if path is not None:
            leads = Path(os.path.relpath(os.path.realpath(path), os.path.realpath(place)))
            image["uri"] = quote(leads.as_posix())
