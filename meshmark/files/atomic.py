"""Files: read only where they are files, written whole or not at all."""

from __future__ import annotations

import json
import math
import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from meshmark.errors import InputError, OutputError
from meshmark.files.temporary import TemporaryFolder

_HIDDEN = ".meshmark-"
# Of Windows, where text would be read otherwise.
_BINARY = getattr(os, "O_BINARY", 0)


@contextmanager
def opened(path: Path) -> Iterator[IO[bytes]]:
    """Open a file to read it.

    Raises
    ------
    InputError
        If it cannot be read, or is no file: a pipe nobody writes to would be waited for for ever,
        and a device may have no end. Links are followed.
    """
    try:
        # Whoever opens a pipe waits for a writer, unless told not to.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _BINARY)
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise InputError("is not a file", source=path)
        with os.fdopen(descriptor, "rb") as file:
            yield file
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=path) from None


def read_small(path: Path, most: int) -> bytes:
    """Read a file that holds a few bytes, `most` at most.

    Raises
    ------
    InputError
        If it cannot be read, is no file, or is larger.
    """
    with opened(path) as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise InputError(f"is too large: more than {most:,} bytes", source=path)
    return data


def require_no_device(path: Path) -> None:
    """Refuse what is neither a file nor a folder, if it is there.

    Raises
    ------
    InputError
        If it is a pipe, a device or the like.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        raise InputError("is neither a file nor a folder", source=path)


@contextmanager
def written_beside(path: Path) -> Iterator[IO[bytes]]:
    """Open a file beside `path`, and put it in place when it is written.

    Raises
    ------
    OutputError
        If it cannot be written; then, and whenever else the block is left by an exception,
        nothing is left of it.
    """
    with beside(path) as place:
        with place.open("xb") as file:
            yield file
        place.replace(path)


@contextmanager
def beside(output: Path) -> Iterator[Path]:
    """Give a path of the same name in a temporary folder beside an output.

    It is on the same disk: what is made there can be moved to the output in one step.

    Raises
    ------
    OutputError
        If the block or the making of the folder raises an `OSError`.
    """
    try:
        folder = TemporaryFolder(output.parent, _HIDDEN)
        try:
            yield folder.path / output.name
        finally:
            folder.remove()
    except OSError as error:
        raise OutputError(f"cannot be written: {error.strerror}", source=output) from None


def write_private(text: str, path: Path) -> None:
    """Make a file that only its owner can read; never in the place of another.

    It appears under its name when it is on the disk, so that no half of it is ever taken for the
    whole; of two that are made at once, one is there.

    Raises
    ------
    FileExistsError
        If there is one already.
    OSError
        If it cannot be written.
    """
    with tempfile.NamedTemporaryFile("w", dir=path.parent, prefix=".", suffix=".tmp") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
        try:
            os.link(file.name, path)
        except FileExistsError:
            raise
        except OSError:
            # Not every disk has links. A second name for the same bytes is all that is needed.
            _claim(text, path)


def _claim(text: str, path: Path) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(descriptor, "w") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
    except BaseException:
        path.unlink()
        raise


def write_json(document: dict[str, Any], path: Path) -> None:
    """Write JSON beside `path`, then put it in place.

    Raises
    ------
    OutputError
        If the folder cannot be written to.
    """
    write_text(json.dumps(document, indent=2, sort_keys=False, allow_nan=False) + "\n", path)


def write_text(text: str, path: Path) -> None:
    """Write text beside `path`, then put it in place; see `write_json`."""
    write_bytes(text.encode("utf-8"), path)


def write_bytes(data: bytes, path: Path) -> None:
    """Write bytes beside `path`, then put them in place; see `write_json`."""
    with written_beside(path) as file:
        file.write(data)


def number(x: float) -> float | None:
    """Return a plain float, or None for what JSON has no word for: not a number, infinite."""
    return float(x) if math.isfinite(x) else None
