"""Forks the processes that read sources, which commands start anew: that takes them a second."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import IO, Any

TICK = 0.002  # seconds


def fork_readers(wanted: bool) -> None:
    """Let reading processes be forked from this one from now on, or started anew."""
    from meshmark.sources.isolation import process

    forked = SimpleNamespace(
        Popen=ForkedReader,
        DEVNULL=subprocess.DEVNULL,
        PIPE=subprocess.PIPE,
        TimeoutExpired=subprocess.TimeoutExpired,
    )
    process.subprocess = forked if wanted else subprocess


class ForkedReader:
    """What `subprocess.Popen` would be to whoever starts a reading process."""

    def __init__(
        self, command: Sequence[str], *, stderr: IO[bytes], env: Mapping[str, str], **_: Any
    ) -> None:
        ours, theirs = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            _read(command, theirs, stderr.fileno(), env)
        os.close(theirs)
        self.stdout = os.fdopen(ours, "rb", buffering=0)
        self.returncode: int | None = None

    def __enter__(self) -> ForkedReader:
        return self

    def __exit__(self, *exception: object) -> None:
        self.stdout.close()
        self.wait()

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end."""
        end = None if timeout is None else time.monotonic() + timeout
        while self.returncode is None:
            pid, status = os.waitpid(self._pid, os.WNOHANG if timeout is not None else 0)
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
            elif end is not None and time.monotonic() > end:
                raise subprocess.TimeoutExpired("reader", timeout or 0.0)
            else:
                time.sleep(TICK)
        return self.returncode

    def kill(self) -> None:
        """End it, if it has not ended."""
        if self.returncode is None:
            os.kill(self._pid, 9)


def _read(command: Sequence[str], out: int, err: int, env: Mapping[str, str]) -> None:
    from meshmark.sources.isolation import child

    code = 1
    try:
        os.dup2(out, 1)
        os.dup2(err, 2)
        os.environ.clear()
        os.environ.update(env)
        # Python, its flags and the module come first.
        sys.argv = ["child", *command[4:]]
        child.main()
        code = 0
    except BaseException:
        sys.excepthook(*sys.exc_info())
        sys.stderr.flush()
    finally:
        os._exit(code)
