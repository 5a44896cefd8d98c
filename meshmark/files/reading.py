"""Files read only where they are files: what never ends is refused."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from meshmark.errors import InputError

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
