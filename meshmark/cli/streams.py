"""What happens when nobody takes what a command says: never something that reads as a verdict."""

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
    """Whoever read our stdout has gone."""


class _Watched:
    """A stream for text whose failures are told from all others."""

    def __init__(self, stream: Any, *, matters: bool) -> None:
        self._stream, self._matters = stream, matters
        self._failure: OSError | None = None

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write text, as far as anybody takes it."""
        self._attempt(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        """Hand over what was written."""
        self._attempt(self._stream.flush)

    def _attempt(self, action: Callable[[], object]) -> None:
        try:
            action()
        except OSError as error:
            self._failure = error
            self._give_up()
        # Again and again: libraries that try what a stream can do take no notice of failures.
        if self._failure is None or not self._matters:
            return
        if isinstance(self._failure, BrokenPipeError):
            raise Unheard
        raise OutputError(f"cannot be written: {self._failure.strerror}", source="stdout")

    def _give_up(self) -> None:
        """Let what is still to come go nowhere: Python would try again when it ends."""
        with suppress(OSError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)


@contextmanager
def watched_streams() -> Iterator[None]:
    """Tell failures of stdout while the block runs, and let those of stderr pass.

    Writing to stdout raises `Unheard` if it is a pipe that nobody reads any more, and `OutputError`
    if it fails for another reason, such as a full disk.
    """
    out, err = sys.stdout, sys.stderr
    # The answer is in the exit code as well: it stands whoever reads the words beside it.
    sys.stdout, sys.stderr = _watched(out, matters=True), _watched(err, matters=False)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = out, err


def _watched(stream: Any, *, matters: bool) -> Any:
    # A program that was started without a stream has None.
    return _Watched(StringIO() if stream is None else stream, matters=matters)
