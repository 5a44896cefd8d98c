"""Which files are the frames of an OBJ sequence, in which order, and at which times."""

from __future__ import annotations

import re
from collections.abc import Sequence
from glob import glob, has_magic
from itertools import pairwise
from pathlib import Path

from meshmark.errors import InputError

_SUFFIX = ".obj"


def is_single(source: str, paths: Sequence[Path]) -> bool:
    """Tell whether the source named one file, rather than a place where there is one."""
    return list(paths) == [Path(source)]


def find_frames(source: str) -> list[Path]:
    """List the OBJ files of a folder, a glob pattern or a single file, in natural order.

    Raises
    ------
    InputError
        If there is nothing there, or no OBJ file in it.
    """
    path = Path(source)
    if path.is_dir():
        found = [child for child in path.iterdir() if _is_obj(child)]
    elif path.exists():
        return [path]
    elif has_magic(source):
        # Path.glob wants a pattern relative to a folder, and a user's may be absolute.
        names = glob(source, recursive=True)  # noqa: PTH207
        found = [Path(name) for name in names if _is_obj(Path(name))]
    else:
        raise InputError("no such file or folder", source=source)
    if not found:
        raise InputError(f"there is no {_SUFFIX} file in it", source=source)
    return sorted(found, key=natural_key)


def looks_like_frames(source: str) -> bool:
    """Tell whether a source names OBJ files, by its name or a glance into the folder."""
    path = Path(source)
    if path.is_dir():
        return any(_is_obj(child) for child in path.iterdir())
    return path.suffix.lower() == _SUFFIX


def natural_key(path: Path) -> tuple[str, list[str | int], str]:
    """Order names as people count: frame2 before frame10."""
    parts = re.split(r"(\d+)", path.name)
    # Splitting at digits alternates text and number, so equal places always hold equal types.
    numbers: list[str | int] = [
        int(part) if i % 2 else part.lower() for i, part in enumerate(parts)
    ]
    return str(path.parent), numbers, path.name


def frame_times(paths: Sequence[Path]) -> list[float]:
    """Give each file of a folder or pattern its time code.

    The number its name ends in, where all names end in one and these increase; otherwise
    1, 2, 3 and so on. A pipeline that exports every second frame as 0001, 0003, 0005 means
    time codes 1, 3, 5.
    """
    ends = [re.search(r"(\d+)$", path.stem) for path in paths]
    numbers = [int(end.group(1)) for end in ends if end]
    increasing = all(a < b for a, b in pairwise(numbers))
    if len(numbers) == len(paths) and increasing:
        return [float(number) for number in numbers]
    return [float(number) for number in range(1, len(paths) + 1)]


def _is_obj(path: Path) -> bool:
    # macOS leaves resource forks named ._x.obj beside the files it copies.
    return path.suffix.lower() == _SUFFIX and not path.name.startswith(".") and path.is_file()
