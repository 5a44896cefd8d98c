"""The files a source consists of, hashed."""

from __future__ import annotations

import hashlib
import os
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from meshmark.errors import InputError
from meshmark.files.reading import opened
from meshmark.mesh.asset import Asset
from meshmark.sources.facts import source_files

CHUNK = 1 << 24  # bytes of a file that are hashed at a time
# What was changed so long ago bears another time if it is changed again: the coarsest file systems
# tell times in steps of two.
SETTLED = 5.0  # seconds


def source_digests(asset: Asset) -> tuple[tuple[str, str], ...]:
    """Return the absolute path and the SHA-256 of each file of an asset's source.

    Where all was read before, they are those of the very bytes that were.
    """
    if asset.facts is not None:
        return asset.facts.files
    files = (path.resolve() for path in source_files(asset.source))
    return tuple((str(path), sha256(path)) for path in files)


def require_unchanged(files: Iterable[tuple[str, str]]) -> None:
    """Refuse to go on with a source of which a file is not what it was.

    Parameters
    ----------
    files : iterable of (str, str)
        As `source_digests` found them.

    Raises
    ------
    InputError
        If one was changed.
    """
    for file, digest in files:
        if sha256(Path(file)) != digest:
            raise InputError("changed while it was read; start again", source=file)


def sha256(path: Path, beat: Callable[[], None] | None = None) -> str:
    """Hash a file; `beat` is called after every few megabytes."""
    digest = hashlib.sha256()
    with opened(path) as file:
        while chunk := file.read(CHUNK):
            digest.update(chunk)
            if beat is not None:
                beat()
    return digest.hexdigest()


def stamps_of(files: Iterable[Path]) -> list[tuple[int, ...]] | None:
    """Tell what would be another of any file that is changed, or exchanged for another one.

    None if that is not certain of one: it was changed a moment ago, and may be within the moment.
    """
    found: list[tuple[int, ...]] = []
    for path in files:
        # Of a file that others serve, the system asks how it is now when it is opened.
        with opened(path) as file:
            now, told = time.time(), os.fstat(file.fileno())
        # Elsewhere that is when it was made, and programs set when it was changed.
        if sys.platform == "win32" or now - told.st_ctime < SETTLED:
            return None
        found.append((told.st_dev, told.st_ino, told.st_size, told.st_mtime_ns, told.st_ctime_ns))
    return found


def file_hashes(files: Iterable[tuple[str, str]], folder: Path) -> list[dict[str, str]]:
    """Name hashed files relative to a folder.

    Parameters
    ----------
    files : iterable of (str, str)
        Absolute path and SHA-256; see `meshmark.sources.digests.source_digests`.

    Returns
    -------
    list of {"file", "sha256"}
        In the order given.
    """
    return [
        {"file": Path(os.path.relpath(file, folder)).as_posix(), "sha256": digest}
        for file, digest in files
    ]
