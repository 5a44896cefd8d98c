"""One shell command a line, for schedulers of render farms: each verifies some of many sources."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from meshmark.errors import UsageError


def verify_commands(
    options: Sequence[str], sources: Sequence[str], chunk: int, answers: Path | None = None
) -> Iterator[str]:
    """Make the commands that verify sources, wherever they are run.

    Parameters
    ----------
    options : sequence of str
        Of `meshmark verify`, for all of them.
    chunk : int
        Sources of a command.
    answers : Path, optional
        Each command resumes a file of its own, which is called like this with a number.

    Raises
    ------
    UsageError
        If a word holds a line break: there would be two lines.
    """
    for number, first in enumerate(range(0, len(sources), chunk), start=1):
        own = [] if answers is None else ["--resume", str(_numbered(answers, number).absolute())]
        named = [str(Path(source).absolute()) for source in sources[first : first + chunk]]
        words = ["meshmark", "verify", *options, *own, *named]
        for word in words:
            if "\n" in word or "\r" in word:
                raise UsageError(f"a line cannot hold the line break in {word!r}")
        yield subprocess.list2cmdline(words) if sys.platform == "win32" else shlex.join(words)


def _numbered(path: Path, number: int) -> Path:
    return path.with_name(f"{path.stem}.{number:04d}{path.suffix}")
