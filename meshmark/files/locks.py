"""Locks on outputs: of two runs that would write the same file, the second is told so at once."""

from __future__ import annotations

import errno
import hashlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from meshmark.errors import OutputError


@contextmanager
def held(output: Path) -> Iterator[None]:
    """Hold an output while the block runs; nobody else on any machine that locks can meanwhile.

    The lock is an empty hidden file beside the output, and ends with its process. Where the disk
    knows no locks, nothing is held.

    Raises
    ------
    OutputError
        If somebody holds it, or the folder cannot be written to.
    """
    # Short whatever the output's name, and one for names that some disks take for the same.
    name = hashlib.sha256(output.name.casefold().encode("utf-8", "surrogateescape")).hexdigest()
    path = output.with_name(f".meshmark-{name[:16]}.lock")
    try:
        descriptor = _locked(path)
    except BlockingIOError:
        raise OutputError("is being written by another run", source=output) from None
    except OSError as error:
        raise OutputError(f"cannot be locked: {error.strerror}", source=output) from None
    try:
        yield
    finally:
        _end(descriptor, path)


if sys.platform == "win32":

    def _locked(path: Path) -> int:
        try:
            # Gone when it is closed, or its process ends.
            return os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_TEMPORARY)
        except (FileExistsError, PermissionError):
            raise BlockingIOError from None

    def _end(descriptor: int, path: Path) -> None:
        os.close(descriptor)

else:
    import fcntl

    # What disks that know no locks answer.
    _NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}

    def _locked(path: Path) -> int:
        while True:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                # Whoever held it may have removed the file in between: that lock locks nobody out.
                if path.stat().st_ino == os.fstat(descriptor).st_ino:
                    return descriptor
            except FileNotFoundError:
                pass
            except OSError as error:
                if error.errno in _NO_LOCKS:
                    return descriptor
                os.close(descriptor)
                raise
            os.close(descriptor)

    def _end(descriptor: int, path: Path) -> None:
        # Removed while it is held: nobody can have it yet.
        path.unlink(missing_ok=True)
        os.close(descriptor)
