"""Failing stdout and stderr: they must never lead to an exit code that reads as a verdict."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import StringIO
from typing import Any

from meshmark.errors import OutputError

# What shells report for a program that wrote into a pipe nobody reads: 128 and SIGPIPE.
UNHEARD = 141


class Unheard(BaseException):
    """The reader of stdout has closed it."""


class _Watched:
    """A text stream whose failures can be told apart from other errors."""

    def __init__(self, stream: Any, *, matters: bool) -> None:
        self._stream, self._matters = stream, matters
        self._failure: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write text, unless the stream has failed."""
        self._attempt(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Flush the stream, unless it has failed."""
        self._attempt(self._stream.flush)

    def _attempt(self, action: Callable[[], object]) -> None:
        try:
            action()
        except OSError as error:
            self._failure = error
            self._give_up()
        # Raise on every call: libraries that probe a stream ignore failures.
        if self._failure is None or not self._matters:
            return
        if isinstance(self._failure, BrokenPipeError):
            raise Unheard
        raise OutputError(f"cannot be written: {self._failure.strerror}", source="stdout")

    def _give_up(self) -> None:
        """Discard all further output: Python would try to flush again at exit."""
        with suppress(OSError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)


@contextmanager
def watched_streams() -> Iterator[None]:
    """Report failures of stdout while the block runs, and ignore those of stderr.

    Writing to stdout raises `Unheard` if it is a pipe whose reader has closed it, and `OutputError`
    if it fails for another reason, such as a full disk.
    """
    out, err = sys.stdout, sys.stderr
    # The exit code gives the answer, too, so a failing stderr does not matter.
    sys.stdout, sys.stderr = _watched(out, matters=True), _watched(err, matters=False)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = out, err


def _watched(stream: Any, *, matters: bool) -> Any:
    # A program that was started without a stream has None.
    return _Watched(StringIO() if stream is None else stream, matters=matters)
