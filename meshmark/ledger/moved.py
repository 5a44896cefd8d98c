"""Where what a ledger tells of lies now: studios move the roots of their folders."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from meshmark.errors import UsageError
from meshmark.ledger.origins import WINDOWS, Origin


@dataclass(frozen=True)
class Move:
    """A folder, and where what was in it is now.

    Parameters
    ----------
    old : str
        As it is recorded; a folder of Windows with either slashes, and in any letter case.
    new : Path
    """

    old: str
    new: Path

    @classmethod
    def of(cls, text: str) -> Move:
        """Read `OLD=NEW`.

        Raises
        ------
        UsageError
            If it is something else.
        """
        old, _, new = text.partition("=")
        if not old.strip() or not new.strip():
            raise UsageError(f"a moved folder is given as OLD=NEW, not {text!r}")
        return cls(old.strip(), Path(new.strip()))

    def __call__(self, path: str) -> Path | None:
        """Return where a path is now; None if it was not in the folder."""
        parts, old = _parts(path), _parts(self.old)
        head = parts[: len(old)]
        if WINDOWS.match(self.old):
            head, old = [each.casefold() for each in head], [each.casefold() for each in old]
        return self.new.joinpath(*parts[len(old) :]) if head == old else None


def moves_of(texts: Iterable[str], variable: str | None) -> list[Move]:
    """Read moved folders, those of an environment variable last, which has `;` between them."""
    further = (variable or "").split(";")
    return [Move.of(each) for each in (*texts, *filter(str.strip, further))]


def moved(origin: Origin, moves: Sequence[Move]) -> Origin:
    """Return an origin with the places of original and master as they are now.

    Of several folders that a path was in, the first counts. A path that was in none stays.
    """
    master: Mapping[str, Any] | None = origin.master
    if master is not None:
        master = {**master, "path": str(place(master["path"], moves))}
    return replace(origin, source=place(str(origin.source), moves), master=master)


def place(path: str, moves: Sequence[Move]) -> Path:
    """Return where a recorded path is now."""
    found = (move(path) for move in moves)
    return next((each for each in found if each is not None), Path(path))


def _parts(path: str) -> list[str]:
    """Take a path apart, with `..` resolved; an empty part first where it begins with a slash."""
    text = path.replace("\\", "/") if os.sep == "\\" or WINDOWS.match(path) else path
    parts: list[str] = []
    for part in text.rstrip("/").split("/"):
        if part == ".." and parts and parts[-1] not in ("", ".."):
            parts.pop()
        elif part != ".":
            parts.append(part)
    return parts
