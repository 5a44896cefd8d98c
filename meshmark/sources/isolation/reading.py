"""Reads a source in a process of its own, and outlives whatever that does to it."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from meshmark.errors import InputError
from meshmark.files.temporary import ScratchFolder
from meshmark.mesh.asset import Asset
from meshmark.sources.isolation.limits import MEMORY_VARIABLE, SECONDS_VARIABLE, Limits
from meshmark.sources.isolation.report import (
    ARRAYS,
    REPORT,
    WITH_TEXTURES,
    WITHOUT,
    asset_from,
    error_from,
)
from meshmark.usd.reader import UsdReader
from meshmark.workers.apart import interpreter_environment

PROGRAM = "meshmark.sources.isolation.child"
COMPLAINTS = "stderr"
# Python and its modules may come from far away.
TO_START = 60.0  # seconds
# Of a report: all but arrays.
MOST_REPORTED = 1 << 26  # bytes
MOST_COMPLAINTS = 1 << 16
# What a report raises that does not fit.
NONSENSE = (AttributeError, LookupError, TypeError, ValueError, OverflowError, RecursionError)


def read_isolated(
    source: str | Path,
    prims: Sequence[str] = (),
    *,
    parameters: Mapping[str, Any] | None = None,
    textures: bool = False,
) -> Asset:
    """Read a source as `meshmark.read` does, in a process of its own that is given limits.

    A file made to crash or to hang a library takes that process with it, and nothing else. All
    frames are read, once, into a temporary file; the asset reads them from there.

    Parameters
    ----------
    source, prims, parameters
        As `meshmark.read` takes them.
    textures : bool
        Read texture coordinates, too.

    Returns
    -------
    Asset
        Its `facts` tell the files it was read from. The temporary file lives as long as the
        asset, its meshes or anything made of them.

    Raises
    ------
    InputError
        As `meshmark.read`; or if reading crashes, needs more memory or time than it is given, or
        if the source changes meanwhile.
    UsageError
        If a wanted mesh is not in it, or a limit makes no sense.
    """
    asked = WITH_TEXTURES if textures else WITHOUT
    given = json.dumps(dict(parameters or {}))
    with isolated(PROGRAM, str(source), asked, given, *prims) as (report, folder):
        return asset_from(report, str(source), folder.path / ARRAYS, folder)


@contextmanager
def isolated(
    program: str, source: str, *arguments: str
) -> Iterator[tuple[dict[str, Any], ScratchFolder]]:
    """Let a process of its own work on a source within limits; give its report and its folder.

    The program is a module that lets `child.Child` run. The block is to make sense of the report;
    the folder is gone if it does not, and otherwise when nobody has it.

    Raises
    ------
    InputError, UsageError
        See `read_isolated`.
    """
    limits = Limits.from_environment()
    folder = ScratchFolder()
    try:
        report = _run([program, str(folder.path), source, *arguments], folder.path, source, limits)
        _require_done(report, source)
        yield report, folder
    except NONSENSE as error:
        folder.remove()
        raise InputError(f"reading it goes astray: {error}", source=source) from None
    except BaseException:
        folder.remove()
        raise


def _run(words: Sequence[str], folder: Path, source: str, limits: Limits) -> dict[str, Any]:
    """Let a process work, and return its report."""
    with (folder / COMPLAINTS).open("wb") as complaints:
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=complaints,
            # What it leaves behind, as pxr does of a crash, goes with its folder.
            env=interpreter_environment({"TMPDIR": str(folder)}),
        )
    with process:
        try:
            if not _goes_on(process, limits.seconds):
                raise InputError(
                    f"reading it gets nowhere in {limits.seconds:g} s; {SECONDS_VARIABLE} can "
                    "allow more",
                    source=source,
                )
        finally:
            process.kill()
    if process.returncode:
        raise InputError(_death(process.returncode, folder, source), source=source)
    with (folder / REPORT).open("rb") as file:
        report = file.read(MOST_REPORTED + 1)
    if len(report) > MOST_REPORTED:
        raise InputError("there is too much to say about it", source=source)
    return dict(json.loads(report))


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


def _require_done(report: dict[str, Any], source: str) -> None:
    """Raise what the process raised."""
    if "error" in report:
        raise error_from(report["error"])
    if "memory" in report:
        raise InputError(
            f"needs more than {report['memory']:g} GB of memory to read; {MEMORY_VARIABLE} can "
            "allow more",
            source=source,
        )
    if "bug" in report:
        bug = RuntimeError(f"{report['bug']} (while {source} was read)")
        bug.add_note(str(report["traceback"]))
        raise bug
