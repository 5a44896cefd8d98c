"""Which files are the frames of an OBJ sequence, in which order, and at which times."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from glob import glob, has_magic
from itertools import pairwise
from pathlib import Path

from meshmark.errors import InputError

_SUFFIX = ".obj"
# A dash is a sign where it follows nothing, or what sets a number apart: anim.-1, not anim-1.
_SIGN = r"(?:(?:^|(?<=[._ -]))-)?"
_WHOLE = re.compile(rf"{_SIGN}\d+$", re.ASCII)
_DECIMAL = re.compile(rf"{_SIGN}\d+(?:\.\d+)?$", re.ASCII)
_LAST_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?=\D*$)", re.ASCII)


@dataclass(frozen=True)
class FrameFiles:
    """The files of a sequence, in time order.

    Parameters
    ----------
    paths : tuple of Path
        One a frame.
    times : tuple of float
        Their time codes; NaN for a single file that was named itself.
    """

    paths: tuple[Path, ...]
    times: tuple[float, ...]

    @property
    def single(self) -> bool:
        """Whether the source named one file, rather than a place where there is one."""
        return math.isnan(self.times[0])


def find_frames(source: str) -> FrameFiles:
    """Find the OBJ files of a folder, a glob pattern or a single file, and their times.

    The time of a file is the number its name ends in, which may have a sign and decimals
    (``anim.-3.obj``, ``anim.1.25.obj``): a pipeline that exports every second frame as 0001,
    0003, 0005 means time codes 1, 3, 5. Files whose names do not end in numbers, and have
    nothing else in common, are in natural order at 1, 2, 3 and so on.

    Raises
    ------
    InputError
        If there is nothing there, no OBJ file in it, or more than one sequence.
    """
    path = Path(source)
    if path.is_dir():
        found = [child for child in path.iterdir() if _is_obj(child)]
    elif path.exists():
        return FrameFiles((path,), (math.nan,))
    elif has_magic(source):
        # Path.glob wants a pattern relative to a folder, and a user's may be absolute.
        names = glob(source, recursive=True)  # noqa: PTH207
        found = [Path(name) for name in names if _is_obj(Path(name))]
    else:
        raise InputError("no such file or folder", source=source)
    if not found:
        raise InputError(f"there is no {_SUFFIX} file in it", source=source)
    return _in_order(sorted(found, key=natural_key), source)


def looks_like_frames(source: str) -> bool:
    """Tell whether a source names OBJ files, by its name or a glance into the folder."""
    path = Path(source)
    if path.is_dir():
        return any(_is_obj(child) for child in path.iterdir())
    return path.suffix.lower() == _SUFFIX


def natural_key(path: Path) -> tuple[list[str | int], str]:
    """Order names as people count: frame2 before frame10."""
    parts = re.split(r"(\d+)", str(path), flags=re.ASCII)
    # Splitting at digits alternates text and number, so equal places always hold equal types.
    return [int(part) if i % 2 else part.lower() for i, part in enumerate(parts)], str(path)


def _in_order(paths: Sequence[Path], source: str) -> FrameFiles:
    whole, decimal = _numbers(paths, _WHOLE), _numbers(paths, _DECIMAL)
    # A name that is nothing but a number is that number.
    if whole and not all(_DECIMAL.fullmatch(path.stem) for path in paths):
        _require_clear(paths, whole, decimal, source)
        decimal = whole
    if not decimal:
        _require_one_sequence(paths, source)
        return FrameFiles(tuple(paths), tuple(float(n) for n in range(1, len(paths) + 1)))
    order = _order(decimal)
    return FrameFiles(tuple(paths[i] for i in order), tuple(decimal[i] for i in order))


def _require_clear(
    paths: Sequence[Path], whole: Sequence[float], decimal: Sequence[float], source: str
) -> None:
    """Refuse names such as a.1.5 and a.1.25, which may be frames 5 and 25, or 1.5 and 1.25."""
    steps = {after - before for before, after in pairwise(sorted(whole))}
    is_count = steps == {1.0} or (len(steps) == 1 and len(whole) > 2)
    if decimal and _order(whole) != _order(decimal) and not is_count:
        raise InputError(
            f"the frames {paths[0].name} to {paths[-1].name} may be {whole[0]:g} to "
            f"{whole[-1]:g} or {decimal[0]:g} to {decimal[-1]:g}, in another order; name them by "
            "whole numbers, or by numbers alone",
            source=source,
        )


def _numbers(paths: Sequence[Path], pattern: re.Pattern[str]) -> list[float]:
    """Read the numbers that names end in; none unless all else in them is the same."""
    ends = [pattern.search(path.stem) for path in paths]
    places = {
        (path.parent, path.stem[: end.start()]) if end else None
        for path, end in zip(paths, ends, strict=True)
    }
    if None in places or len(places) > 1:
        return []
    numbers = [float(end.group()) for end in ends if end]
    return numbers if len(set(numbers)) == len(numbers) else []


def _order(numbers: Sequence[float]) -> list[int]:
    return sorted(range(len(numbers)), key=numbers.__getitem__)


def _require_one_sequence(paths: Sequence[Path], source: str) -> None:
    """Refuse files of several sequences, one beside a sequence, and two of one frame."""
    numbers = [_LAST_NUMBER.search(str(path)) for path in paths]
    groups = Counter(_pattern(path, number) for path, number in zip(paths, numbers, strict=True))
    largest, size = groups.most_common(1)[0]
    if size == 1:
        return
    if len(groups) > 1:
        told = ", ".join(f"{Path(name).name} ({n})" for name, n in groups.most_common(3))
        raise InputError(
            f"it holds more than one sequence of frames, or other files beside one: {told}; "
            f"name the one that is meant, as in '{largest}'",
            source=source,
        )
    taken: dict[float, Path] = {}
    for path, number in zip(paths, numbers, strict=True):
        other = taken.setdefault(float(number.group()), path) if number else path
        if other is not path:
            raise InputError(f"{other.name} and {path.name} are the same frame", source=source)


def _pattern(path: Path, number: re.Match[str] | None) -> str:
    """Return a glob pattern of all that differ from a path in its last number only."""
    name = str(path)
    return f"{name[: number.start()]}[-0-9]*{name[number.end() :]}" if number else name


def _is_obj(path: Path) -> bool:
    # macOS leaves resource forks named ._x.obj beside the files it copies.
    return path.suffix.lower() == _SUFFIX and not path.name.startswith(".") and path.is_file()
