"""Temporary folders that are gone in the end: with their process, or at the latest with the next.

A process that is killed tidies nothing away. Each folder holds a lock that the system takes back
when its process ends, however that ends; what nobody holds any more is removed by whoever makes
a folder there next.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import weakref
from contextlib import suppress
from pathlib import Path

from meshmark.errors import OutputError

if sys.platform != "win32":
    # There, what is left stays until somebody removes it.
    import fcntl

PREFIX = "meshmark-"
LOCK = ".meshmark-lock"


class TemporaryFolder:
    """A new folder that lives as long as this object does, or its process.

    Parameters
    ----------
    parent : Path
        Where it is made. Folders that killed processes of the same user left there are removed.
    prefix : str
        What its name begins with.

    Raises
    ------
    OSError
        If it cannot be made.
    """

    def __init__(self, parent: Path, prefix: str = PREFIX) -> None:
        _remove_stale(parent, prefix)
        self.path = Path(tempfile.mkdtemp(prefix=prefix, dir=parent))
        lock = _hold(self.path)
        # A fork of this process has a copy of this object, but not the say.
        self._finalizer = weakref.finalize(self, _remove, self.path, lock, os.getpid())

    def remove(self) -> None:
        """Remove it now."""
        self._finalizer()


def shared_folder() -> TemporaryFolder:
    """Return the folder for this process's temporary files, which lives while anybody has it.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    key = (os.getpid(), tempfile.gettempdir())
    folder = _shared.get(key)
    if folder is None:
        folder = _shared[key] = TemporaryFolder(Path(key[1]))
    return folder


class ScratchFolder:
    """A temporary folder that lives as long as this object does, or its process.

    Raises
    ------
    OutputError
        If there is no place for it.
    """

    def __init__(self) -> None:
        try:
            self._within = shared_folder()
            self.path = Path(tempfile.mkdtemp(dir=self._within.path))
        except OSError as error:
            raise OutputError(no_room(error)) from None
        self._finalizer = weakref.finalize(self, shutil.rmtree, self.path, ignore_errors=True)

    def remove(self) -> None:
        """Remove it now."""
        self._finalizer()
        del self._within


def no_room(error: OSError) -> str:
    """Say why a temporary file cannot be made, and what to do."""
    return f"no temporary file can be made: {error.strerror}; TMPDIR can name another folder"


_shared: weakref.WeakValueDictionary[tuple[int, str], TemporaryFolder] = (
    weakref.WeakValueDictionary()
)
_looked_through: set[tuple[Path, str]] = set()


def _hold(folder: Path) -> int | None:
    """Lock a folder for as long as this process lives; the lock is there when it is held."""
    if sys.platform == "win32":
        return None
    descriptor = os.open(folder / f"{LOCK}.new", os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        # Not every disk has locks. Without one, nobody takes the folder for a stale one.
        os.close(descriptor)
        return None
    (folder / f"{LOCK}.new").rename(folder / LOCK)
    return descriptor


def _remove(folder: Path, lock: int | None, owner: int) -> None:
    if os.getpid() != owner:
        return
    shutil.rmtree(folder, ignore_errors=True)
    if lock is not None:
        os.close(lock)


def _remove_stale(parent: Path, prefix: str) -> None:
    if sys.platform == "win32" or (parent, prefix) in _looked_through:
        return
    _looked_through.add((parent, prefix))
    # Who may not look there may not remove anything either.
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if entry.name.startswith(prefix) and entry.is_dir(follow_symlinks=False):
                with suppress(OSError):
                    _remove_if_stale(entry)


def _remove_if_stale(entry: os.DirEntry[str]) -> None:
    assert sys.platform != "win32"
    if entry.stat(follow_symlinks=False).st_uid != os.getuid():
        return
    lock = os.open(Path(entry.path) / LOCK, os.O_RDWR | os.O_NOFOLLOW)
    try:
        # Whoever lives holds it.
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        shutil.rmtree(entry.path, ignore_errors=True)
    finally:
        os.close(lock)
