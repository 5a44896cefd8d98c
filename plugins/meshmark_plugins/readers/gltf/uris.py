"""What a glTF file names: data within it, and files beside it."""

from __future__ import annotations

import binascii
import re
from contextlib import suppress
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.element import Element

_DATA = re.compile(r"data:[^,]*;base64,", re.IGNORECASE)
# A scheme, or a drive of Windows.
_SCHEME = re.compile(r"[a-z][a-z0-9+.-]*:", re.IGNORECASE)


def embedded(uri: str) -> bytes | None:
    """Decode a data URI; None if it is none.

    Raises
    ------
    InputError
        If it is not base64.
    """
    if uri[:5].lower() != "data:":
        return None
    head = _DATA.match(uri)
    if head is None:
        raise InputError("is a data URI that is not in base64")
    try:
        return binascii.a2b_base64(uri[head.end() :], strict_mode=True)
    except ValueError as error:
        raise InputError(f"is not base64: {error}") from None


def embedded_head(uri: str) -> str | None:
    """Return what comes before the data of a data URI in base64; None if it is none."""
    head = _DATA.match(uri)
    return None if head is None else head.group()


def file_beside(uri: str, folder: Path) -> Path:
    """Return the file that a URI names; it must be in the folder, or below.

    Raises
    ------
    InputError
        If it is absolute, climbs out of the folder, names another place, or nothing.
    """
    if _SCHEME.match(uri):
        raise InputError("names another place; only files beside the source are read")
    # Windows separates by backslashes, too.
    name = unquote(uri).replace("\\", "/")
    parts = PurePosixPath(name).parts
    if "\0" in name or not parts:
        raise InputError("is no name of a file")
    if name.startswith("/") or ".." in parts or ":" in parts[0]:
        raise InputError("leads out of the folder of the source")
    return folder.joinpath(*parts)


def buffer_files(root: Element, folder: Path) -> list[Path]:
    """List the files of buffers that can be read: those that are there, in the folder or below."""
    found: dict[Path, None] = {}
    for buffer in root.objects("buffers"):
        # What leads elsewhere is told of when it is needed.
        with suppress(InputError):
            path = file_beside(buffer.text("uri"), folder)
            if path.is_file():
                found[path] = None
    return sorted(found)


def files_named(root: Element, folder: Path) -> list[Path]:
    """List every file that buffers and images name, wherever, and whether it is there or not."""
    found: dict[Path, None] = {}
    for each in (*root.objects("buffers"), *root.objects("images")):
        path = any_file(each.text("uri", ""), folder)
        if path is not None:
            found[path] = None
    return list(found)


def any_file(uri: str, folder: Path) -> Path | None:
    """Return the file that a URI names, wherever it is; None if it names none."""
    name = unquote(uri).replace("\\", "/")
    return folder / name if name and not _SCHEME.match(uri) and "\0" not in name else None
