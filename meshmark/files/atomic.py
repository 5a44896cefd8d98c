"""Files written whole or not at all."""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from meshmark.errors import OutputError
from meshmark.files.temporary import TemporaryFolder

_HIDDEN = ".meshmark-"


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
