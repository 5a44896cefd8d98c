"""What people read: messages and progress, on stderr only; stdout is for data."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import typer

FEW = 3

BEAT_EVERY = 10.0  # seconds


def say(text: str) -> None:
    """Tell a person something."""
    typer.echo(text, err=True)


def warn(text: str) -> None:
    """Tell a person that something needs a look."""
    typer.secho(f"warning: {text}", fg="yellow", err=True)


def few(texts: Sequence[str], every: bool = False, tell: Callable[[str], None] = warn) -> None:
    """Tell of the first few of many things, and how many there are; or of every one."""
    shown = len(texts) if every or len(texts) <= FEW + 1 else FEW
    for text in texts[:shown]:
        tell(text)
    if shown < len(texts):
        tell(f"and {len(texts) - shown} more; --all lists them")


def complain(text: str) -> None:
    """Tell a person what went wrong, in one line."""
    typer.secho(f"error: {' '.join(text.split())}", fg="red", err=True)


def put_json(document: Any) -> None:
    """Put a document on stdout."""
    typer.echo(json.dumps(document, indent=2, allow_nan=False))


class FrameProgress:
    """Progress bars, one for each stage and mesh that is not through."""

    def __init__(self, progress: Any) -> None:
        self._progress = progress
        self._tasks: dict[tuple[str, str], Any] = {}

    def __call__(self, stage: str, what: str, done: int, total: int) -> None:
        """Show that `done` of `total` frames of something are through a stage."""
        task = self._tasks.get((stage, what))
        if task is None:
            task = self._progress.add_task(f"{stage} {what}", total=total)
            self._tasks[stage, what] = task
        self._progress.update(task, completed=done, total=total, visible=done < total)


class Heartbeat:
    """Now and then a line about what is being done and for how long, where there are no bars."""

    def __init__(self) -> None:
        self._now: tuple[str, str, int, int] | None = None
        self._since = 0.0

    def __call__(self, stage: str, what: str, done: int, total: int) -> None:
        """Remember that `done` of `total` frames of something are through a stage."""
        if self._now is None or self._now[:2] != (stage, what):
            self._since = time.monotonic()
        self._now = (stage, what, done, total)

    def beat(self, ended: threading.Event) -> None:
        """Say so every `BEAT_EVERY` seconds until an event."""
        while not ended.wait(BEAT_EVERY):
            if self._now is not None:
                stage, what, done, total = self._now
                say(f"{stage} {what}: {done} of {total}, {time.monotonic() - self._since:.0f} s")


@contextmanager
def frame_progress() -> Iterator[FrameProgress | Heartbeat]:
    """Show progress while the block runs: bars on a terminal, now and then a line elsewhere."""
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
