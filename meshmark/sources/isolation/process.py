"""A process of its own that works on a source: started, ahead of time or not, and outlived."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from meshmark.errors import InputError
from meshmark.files.temporary import ScratchFolder
from meshmark.sources.isolation.limits import MEMORY_VARIABLE, SECONDS_VARIABLE, Limits
from meshmark.workers.apart import interpreter_environment

# The program that reads, what it is told, and what it leaves in its folder.
PROGRAM = "meshmark.sources.isolation.child"
WITH_TEXTURES, WITHOUT = "textures", "-"
ARRAYS, REPORT = "arrays", "report.json"
COMPLAINTS = "stderr"
# Python and its modules may come from far away.
TO_START = 60.0  # seconds
# Of a report: all but arrays.
MOST_REPORTED = 1 << 26  # bytes
MOST_COMPLAINTS = 1 << 16


class IsolatedProcess:
    """A process that works on a source within limits, and leaves a report in a folder.

    Parameters
    ----------
    program : str
        A module that lets `child.Child` run.
    source : str
        The source.
    arguments : str
        What else the program is told.
    """

    def __init__(self, program: str, source: str, *arguments: str) -> None:
        self._source, self._limits = source, Limits.from_environment()
        self.folder = ScratchFolder()
        path = self.folder.path
        words = [sys.executable, "-P", "-m", program, str(path), source, *arguments]
        try:
            with (path / COMPLAINTS).open("wb") as complaints:
                self._process = subprocess.Popen(
                    words,
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=complaints,
                    # What it leaves behind, as pxr does of a crash, goes with its folder.
                    env=interpreter_environment({"TMPDIR": str(path)}),
                )
        except BaseException:
            self.folder.remove()
            raise

    def report(self) -> dict[str, Any]:
        """Wait until it is done, and return its report.

        Raises
        ------
        InputError
            If it crashes, or needs more memory or time than it is given.
        """
        with self._process as process:
            try:
                if not _goes_on(process, self._limits.seconds):
                    raise InputError(
                        f"reading it gets nowhere in {self._limits.seconds:g} s; "
                        f"{SECONDS_VARIABLE} can allow more",
                        source=self._source,
                    )
            finally:
                process.kill()
        folder, source = self.folder.path, self._source
        if process.returncode:
            raise InputError(_death(process.returncode, folder, source), source=source)
        with (folder / REPORT).open("rb") as file:
            report = file.read(MOST_REPORTED + 1)
        if len(report) > MOST_REPORTED:
            raise InputError("there is too much to say about it", source=source)
        return dict(json.loads(report))

    def drop(self) -> None:
        """End it, and remove what it left."""
        with self._process as process:
            process.kill()
        self.folder.remove()


# Processes that were started ahead of time, by what they were told.
_ahead: dict[tuple[str, ...], IsolatedProcess] = {}


def read_ahead(source: str, textures: bool) -> None:
    """Start reading a source, without parameters, before everything is imported that asks for it.

    `read_isolated` waits for that process then, if it asks for the same. It is started only once.
    """
    words = (PROGRAM, source, WITH_TEXTURES if textures else WITHOUT, "{}")
    if words not in _ahead:
        _ahead[words] = IsolatedProcess(*words)


def drop_ahead() -> None:
    """End what was started ahead of time, and is not needed."""
    while _ahead:
        _ahead.popitem()[1].drop()


def started(program: str, source: str, *arguments: str) -> IsolatedProcess:
    """Return the process that was started to do this, or start one."""
    found = _ahead.pop((program, source, *arguments), None)
    return IsolatedProcess(program, source, *arguments) if found is None else found


def _goes_on(process: subprocess.Popen[bytes], seconds: float) -> bool:
    """Wait until a process ends; tell whether it got on all the time."""
    assert process.stdout is not None
    said: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    # A descriptor of its own: whoever is told to stop closes the other one at any moment.
    descriptor = os.dup(process.stdout.fileno())
    listener = threading.Thread(target=_listen, args=(descriptor, said), daemon=True)
    listener.start()
    patience = max(seconds, TO_START)
    try:
        while said.get(timeout=patience):
            patience = seconds
        process.wait(timeout=seconds)
    except (queue.Empty, subprocess.TimeoutExpired):
        return False
    finally:
        # What is written by then is read, and nobody reads any more.
        process.kill()
        listener.join()
    return True


def _listen(descriptor: int, said: queue.SimpleQueue[bytes]) -> None:
    with open(descriptor, "rb", buffering=0) as pipe:
        while some := pipe.read(1 << 16):
            said.put(some)
    said.put(b"")


def _death(code: int, folder: Path, source: str) -> str:
    """Say how the process ended."""
    # Only here: it takes numpy.
    from meshmark.usd.reader import UsdReader

    reader = "the USD library" if UsdReader().accepts(source) else "its reader"
    if code == -getattr(signal, "SIGKILL", 0):
        return "the process that reads it was killed, as when memory runs out"
    if code < 0:
        return (
            f"crashes {reader} (signal {-code}), or needs more memory than {MEMORY_VARIABLE} allows"
        )
    with (folder / COMPLAINTS).open("rb") as file:
        lines = file.read(MOST_COMPLAINTS).decode(errors="replace").split("\n")
    last = next((line.strip() for line in reversed(lines) if line.strip()), "no reason given")
    return f"the process that reads it ended with {code}: {last}"
