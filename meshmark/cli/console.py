"""Messages and progress for people, on stderr only; stdout is for data."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import typer

FEW = 3
# Exit codes of answers.
MARKED, NOT_MARKED, INCONCLUSIVE = 0, 1, 4

BEAT_EVERY = 10.0  # seconds


def exit_code(answers: Iterable[str]) -> int:
    """Return 0 if all are marked, else 1 if one is not, else 4."""
    told = set(answers)
    if "not marked" in told:
        return NOT_MARKED
    return INCONCLUSIVE if "inconclusive" in told else MARKED


def say(text: str) -> None:
    """Print a message."""
    typer.echo(text, err=True)


def warn(text: str) -> None:
    """Print a warning."""
    typer.secho(f"warning: {text}", fg="yellow", err=True)


def few(
    texts: Sequence[str],
    every: bool = False,
    tell: Callable[[str], None] = warn,
    most: int = FEW,
) -> None:
    """Print the first few of many messages and the number of the others, or all of them."""
    shown = len(texts) if every or len(texts) <= most + 1 else most
    for text in texts[:shown]:
        tell(text)
    if shown < len(texts):
        tell(f"and {len(texts) - shown} more; --all lists them")


def by_text(remarks: Iterable[tuple[str, str]]) -> list[str]:
    """Say what is said of several prims once: `/A, /B and 3 more: text`.

    Parameters
    ----------
    remarks : iterable of (str, str)
        A prim, and what is said of it.
    """
    prims: dict[str, list[str]] = {}
    for prim, text in remarks:
        prims.setdefault(text, []).append(prim)
    return [f"{_listed(names)}: {text}" for text, names in prims.items()]


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(names[:FEW])
    return f"{shown} and {len(names) - FEW} more" if len(names) > FEW else shown


def complain(text: str) -> None:
    """Print an error, in one line."""
    typer.secho(f"error: {' '.join(text.split())}", fg="red", err=True)


def put_json(document: Any) -> None:
    """Print a JSON document on stdout."""
    typer.echo(json.dumps(document, indent=2, allow_nan=False))


class FrameProgress:
    """Progress bars, one for each stage and mesh that is not finished."""

    def __init__(self, progress: Any) -> None:
        self._progress = progress
        self._tasks: dict[tuple[str, str], Any] = {}

    def __call__(self, stage: str, what: str, done: int, total: int) -> None:
        """Show that a stage has finished `done` of `total` frames of `what`."""
        task = self._tasks.get((stage, what))
        if task is None:
            task = self._progress.add_task(f"{stage} {what}", total=total)
            self._tasks[stage, what] = task
        self._progress.update(task, completed=done, total=total, visible=done < total)


class Heartbeat:
    """A regular line about the current task and its time, where there are no progress bars."""

    def __init__(self) -> None:
        self._now: tuple[str, str, int, int] | None = None
        self._since = 0.0

    def __call__(self, stage: str, what: str, done: int, total: int) -> None:
        """Remember that a stage has finished `done` of `total` frames of `what`."""
        if self._now is None or self._now[:2] != (stage, what):
            self._since = time.monotonic()
        self._now = (stage, what, done, total)

    def beat(self, ended: threading.Event) -> None:
        """Print the line every `BEAT_EVERY` seconds until `ended` is set."""
        while not ended.wait(BEAT_EVERY):
            if self._now is not None:
                stage, what, done, total = self._now
                say(f"{stage} {what}: {done} of {total}, {time.monotonic() - self._since:.0f} s")


@contextmanager
def frame_progress() -> Iterator[FrameProgress | Heartbeat]:
    """Show progress while the block runs: bars on a terminal, regular lines elsewhere."""
    with (_bars if sys.stderr.isatty() else _lines)() as progress:
        yield progress


@contextmanager
def _lines() -> Iterator[Heartbeat]:
    heartbeat, ended = Heartbeat(), threading.Event()
    thread = threading.Thread(target=heartbeat.beat, args=(ended,), daemon=True)
    thread.start()
    try:
        yield heartbeat
    finally:
        ended.set()
        thread.join()


@contextmanager
def _bars() -> Iterator[FrameProgress]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        yield FrameProgress(progress)


@contextmanager
def batch_progress(
    stage: str, total: int, *, printing: bool = False
) -> Iterator[Callable[[], None]]:
    """Show how many of many sources are done, how fast, and what is left; call it for each.

    Messages may be printed meanwhile: a bar stays below them.

    Parameters
    ----------
    printing : bool
        Whether stdout is printed to, too: on one terminal there is no bar then.
    """
    if not sys.stderr.isatty() or (printing and sys.stdout.isatty()):
        with _lines() as heartbeat:
            done = 0

            def told() -> None:
                nonlocal done
                done += 1
                heartbeat(stage, "sources", done, total)

            heartbeat(stage, "sources", 0, total)
            yield told
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    # What is data goes where it is sent.
    bar = Progress(*columns, console=Console(stderr=True), transient=True, redirect_stdout=False)
    with bar:
        task = bar.add_task(stage, total=total, rate="")
        begun = time.monotonic()

        def shown() -> None:
            bar.advance(task)
            minutes = max(time.monotonic() - begun, 1e-3) / 60.0
            bar.update(task, rate=f"{bar.tasks[0].completed / minutes:.1f} a minute")

        yield shown
