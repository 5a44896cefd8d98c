"""Places to write to: what lies beside an output, and whether the source may ever need it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from glob import escape
from pathlib import Path

from meshmark.errors import OutputError

# Where the system does not tell.
USUAL_NAME_BYTES = 255


def assets_folder(output: Path) -> Path:
    """Return the folder beside a deliverable that files out of packages are copied into."""
    return output.with_name(f"{output.name}.assets")


def data_file(output: Path, index: int) -> Path:
    """Return the file beside an output that holds part `index` of its data, if it needs any."""
    return output.with_name(f"{output.name}.{index}.bin")


def data_files(output: Path) -> list[Path]:
    """List the files of an output's data that are beside it, sorted."""
    return sorted(output.parent.glob(f"{escape(output.name)}.*.bin"))


def require_apart(outputs: Iterable[Path], files: Iterable[Path]) -> None:
    """Refuse outputs that are, or hold, a file of the source: by path, link or letter case.

    Letter case never counts: on some disks names that differ by it are one file.

    Raises
    ------
    OutputError
        If one is.
    """
    taken: set[str | tuple[int, int]] = set()
    for file in files:
        taken |= _identities(file) | set(map(_folded, _resolved(file).parents))
    for output in outputs:
        if not taken.isdisjoint(_identities(output)):
            raise OutputError("is part of the source and will not be overwritten", source=output)


def require_names_fit(outputs: Iterable[Path]) -> None:
    """Refuse names that are too long for the folder they are to be in.

    Raises
    ------
    OutputError
        If one is.
    """
    for output in outputs:
        longest = _name_bytes(output.parent)
        if len(os.fsencode(output.name)) > longest:
            raise OutputError(f"the name has more than {longest} bytes", source=output)


def _identities(path: Path) -> set[str | tuple[int, int]]:
    """Name a file by all that tells it: its paths, and its inode if it is there."""
    known: set[str | tuple[int, int]] = {_folded(path.absolute()), _folded(_resolved(path))}
    try:
        status = path.stat()
    except OSError:
        return known
    return known | {(status.st_dev, status.st_ino)}


def _resolved(path: Path) -> Path:
    # Path.resolve raises where links lead in a circle.
    return Path(os.path.realpath(path))


def _folded(path: Path) -> str:
    return os.path.normpath(path).casefold()


def _name_bytes(folder: Path) -> int:
    try:
        return os.pathconf(folder, "PC_NAME_MAX")
    except (AttributeError, OSError, ValueError):
        return USUAL_NAME_BYTES
