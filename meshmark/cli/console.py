"""What people read: messages and progress, on stderr only; stdout is for data."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import typer

FEW = 3


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
    """Progress bars, one for each stage and mesh."""

    def __init__(self, progress: Any) -> None:
        self._progress = progress
        self._tasks: dict[tuple[str, str], Any] = {}

    def __call__(self, stage: str, prim: str, done: int, total: int) -> None:
        """Show that `done` of `total` frames are through a stage."""
        task = self._tasks.get((stage, prim))
        if task is None:
            task = self._progress.add_task(f"{stage} {prim}", total=total)
            self._tasks[stage, prim] = task
        self._progress.update(task, completed=done)


class Silence:
    """Progress that nobody watches."""

    def __call__(self, stage: str, prim: str, done: int, total: int) -> None:
        """Show nothing."""


@contextmanager
def frame_progress() -> Iterator[FrameProgress | Silence]:
    """Show progress bars while the block runs, if stderr is a terminal."""
    if not sys.stderr.isatty():
        yield Silence()
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
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        yield FrameProgress(progress)
