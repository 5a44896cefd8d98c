"""Signals that end a command: what it began is tidied away, and its workers end with it."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from meshmark.parallel import abandon_workers

# What schedulers, closed terminals and people send. Not every system knows all of them.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


class Stopped(BaseException):
    """Whoever started the command wants it to end.

    Parameters
    ----------
    signum : int
        The signal that said so.
    """

    def __init__(self, signum: int) -> None:
        super().__init__(f"stopped by {signal.Signals(signum).name}")
        # What shells report for a program that a signal ended.
        self.exit_code = 128 + signum


@contextmanager
def stopping() -> Iterator[None]:
    """Turn signals into `Stopped`, so that files half-written are removed on the way out.

    Signals that are ignored stay so: `nohup` ignores SIGHUP.
    """
    signums = [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]
    before = {signum: signal.getsignal(signum) for signum in signums}
    heard = [signum for signum in signums if before[signum] is not signal.SIG_IGN]
    try:
        for signum in heard:
            signal.signal(signum, _stop)
        yield
    finally:
        for signum in heard:
            signal.signal(signum, before[signum])


def _stop(signum: int, frame: FrameType | None) -> None:
    # Nobody wants what they are at any more, and a frame can take them long.
    abandon_workers()
    raise Stopped(signum)
