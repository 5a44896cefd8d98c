"""What a command line names by folders, patterns and lists: one source after the other."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator
from functools import lru_cache
from glob import escape, has_magic
from itertools import groupby
from pathlib import Path

from meshmark.errors import InputError
from meshmark.files.reading import read_small
from meshmark.sources.readers import find_reader

# Of a list of sources.
LONGEST = 1 << 28  # bytes


def listed(words: Iterable[str]) -> list[str]:
    """List the sources that words name, each once, in the order of the words.

    Parameters
    ----------
    words : iterable of str
        A file; a folder, for all below it that a reader accepts; a pattern, as `glob` takes it;
        or `@FILE` for those that a file names one a line. `@@name` is the file `@name`. Frames of
        which a reader takes a whole folder or pattern are one source.

    Returns
    -------
    list of str
        What a folder or a pattern holds is sorted.

    Raises
    ------
    InputError
        If a list cannot be read, or there is nothing in a folder or list or behind a pattern.
    """
    found: dict[tuple[str, str], str] = {}
    # Whoever follows a link to a file finds what it uses elsewhere: only its folder is resolved.
    resolved = lru_cache(os.path.realpath)
    for word in words:
        for source in _sources(word):
            folder, name = os.path.split(source)
            found.setdefault((resolved(folder), name), source)
    return list(found.values())


def _sources(word: str) -> Iterable[str]:
    if word.startswith("@") and not word.startswith("@@"):
        return _in_list(Path(word[1:]))
    return _named(word[1:] if word.startswith("@@") else word)


def _in_list(path: Path) -> list[str]:
    """List what a file names: relative to where the user stands; lines with `#` tell nothing."""
    text = os.fsdecode(read_small(path, LONGEST).removeprefix(b"\xef\xbb\xbf"))
    lines = (line.removesuffix("\r") for line in text.split("\n"))
    names = [line for line in lines if line.strip() and not line.startswith("#")]
    if not names:
        raise InputError("names no source", source=path)
    return [source for name in names for source in _named(name)]


def _named(name: str) -> Iterable[str]:
    """List the sources that a file, folder or pattern is; what is missing, its reader tells."""
    path = Path(name)
    if path.is_dir():
        return _required(_below(path), "holds nothing that can be read", name)
    if has_magic(name) and not path.exists():
        return _required(_matching(name), "matches nothing that can be read", name)
    return [name]


def _required(sources: Iterable[str], refusal: str, name: str) -> list[str]:
    found = sorted(set(sources))
    if not found:
        raise InputError(refusal, source=name)
    return found


def _below(top: Path) -> Iterator[str]:
    """Find the sources in a folder and those below; links are followed last, and nothing twice."""
    seen: set[tuple[int, int]] = set()
    folders, links = deque([top]), deque[Path]()
    while folders or links:
        folder = (folders or links).popleft()
        try:
            status = folder.stat()
            entries = sorted(folder.iterdir())
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", source=folder) from None
        if (status.st_dev, status.st_ino) in seen:
            continue
        seen.add((status.st_dev, status.st_ino))
        shown = [entry for entry in entries if not entry.name.startswith(".")]
        yield from _in_one_folder(folder, shown, str(folder))
        for entry in shown:
            if entry.is_dir():
                (links if entry.is_symlink() else folders).append(entry)


def _matching(pattern: str) -> Iterator[str]:
    """Find the sources that a pattern matches, and those in folders that it matches."""
    for folder, group in groupby(sorted(_glob(Path(pattern))), key=lambda path: path.parent):
        matches = list(group)
        # Frames in one folder, or in several if the pattern says so by itself.
        across = "**" not in Path(pattern).parts
        frames = pattern if across else str(Path(escape(str(folder))) / Path(pattern).name)
        yield from _in_one_folder(folder, matches, frames)
        for path in matches:
            if path.is_dir():
                yield from _below(path)


def _in_one_folder(folder: Path, entries: Iterable[Path], frames: str) -> Iterator[str]:
    """Find the sources among entries of a folder: files, and frames that are one source.

    Parameters
    ----------
    frames : str
        What those are called together; the folder, where their reader does not accept that.
    """
    whole = find_reader(str(folder))
    for path in entries:
        reader = find_reader(str(path)) if path.is_file() else None
        if reader is None:
            continue
        if whole is not None and whole.name == reader.name:
            yield frames if whole.accepts(frames) else str(folder)
        else:
            yield str(path)


def _glob(pattern: Path) -> Iterator[Path]:
    """Match a pattern, relative to its first folder without wildcards; nothing hidden."""
    wild = next(index for index, part in enumerate(pattern.parts) if has_magic(part))
    base = Path(*pattern.parts[:wild])
    wanted = pattern.parts[wild:]
    for path in base.glob(str(Path(*wanted))):
        hidden = any(part.startswith(".") for part in path.relative_to(base).parts)
        if not hidden or any(part.startswith(".") for part in wanted):
            yield path
