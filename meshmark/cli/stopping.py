"""Signals that end a command: temporary files are removed, and workers end with it."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from types import FrameType

from meshmark.workers.pool import abandon_workers

# What schedulers, closed terminals and people send. Not every system knows all of them.
_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
REMIND_EVERY = 0.1  # seconds
# An interrupted import may fail with another error; an interrupted creation leaves its file behind;
# an interrupted record may have been made.
NOT_CUT_SHORT = (
    "importlib._bootstrap",
    "tempfile",
    "meshmark.files.temporary",
    "meshmark.embedding.undoing",
)


class Stopped(BaseException):
    """A signal asked the command to end.

    Parameters
    ----------
    signum : int
        The signal.
    """

    def __init__(self, signum: int) -> None:
        super().__init__(f"stopped by {signal.Signals(signum).name}")
        # What shells report for a program that a signal ended.
        self.exit_code = 128 + signum


@contextmanager
def stopping() -> Iterator[None]:
    """Turn signals into `Stopped`, so that half-written files are removed.

    Ignored signals stay ignored: `nohup` ignores SIGHUP.
    """
    signums = [getattr(signal, name) for name in _NAMES if hasattr(signal, name)]
    before = {signum: signal.getsignal(signum) for signum in signums}
    heard = [signum for signum in signums if before[signum] is not signal.SIG_IGN]
    stop = _Stop()
    try:
        for signum in heard:
            signal.signal(signum, stop)
        yield
    except Exception as error:
        if stop.signum is None:
            raise
        # Some libraries turn `Stopped` into an error of their own.
        raise Stopped(stop.signum) from error
    finally:
        stop.forget()
        for signum in heard:
            signal.signal(signum, before[signum])


class _Stop:
    """A signal handler that raises `Stopped` until it propagates.

    Compiled libraries swallow exceptions raised in their callbacks into Python, so raising it once
    may not be enough.
    """

    def __init__(self) -> None:
        self.signum: int | None = None
        self._reminder: threading.Thread | None = None
        self._is_over = threading.Event()

    def __call__(self, signum: int, frame: FrameType | None) -> None:
        if _is_being_handled(Stopped):
            # A second signal, as by a terminal and a scheduler, must not interrupt the cleanup.
            return
        if self.signum is None:
            self.signum = signum
            reminder = threading.Thread(target=self._remind, daemon=True)
            reminder.start()
            self._reminder = reminder
        if _is_within(frame, NOT_CUT_SHORT):
            return
        # Their results are not needed any more, and one frame can take them long.
        abandon_workers()
        raise Stopped(self.signum)

    def _remind(self) -> None:
        assert self.signum is not None
        while not self._is_over.wait(REMIND_EVERY):
            _remind_main_thread(self.signum)

    def forget(self) -> None:
        """Stop sending reminders."""
        self._is_over.set()
        if self._reminder is not None:
            self._reminder.join()


def _remind_main_thread(signum: int) -> None:
    if sys.platform == "win32":
        # Sending a signal to a process would end it there.
        signal.raise_signal(signum)
    else:
        main = threading.main_thread().ident
        assert main is not None
        signal.pthread_kill(main, signum)


def _is_being_handled(kind: type[BaseException]) -> bool:
    error = sys.exc_info()[1]
    while error is not None and not isinstance(error, kind):
        error = error.__context__
    return error is not None


def _is_within(frame: FrameType | None, modules: Collection[str]) -> bool:
    while frame is not None and frame.f_globals.get("__name__") not in modules:
        frame = frame.f_back
    return frame is not None
