"""Answers for many sources, each in a process that works on nothing else meanwhile."""

from __future__ import annotations

import os
import pickle
import queue
import threading
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshmark.commands.outcome import AnyRequest, Outcome, failed
from meshmark.errors import InputError, MeshmarkError, OutputError, TimeLimitError, WorkerError
from meshmark.sources.isolation.limits import limit_memory, memory_to_measure
from meshmark.workers.apart import Apart

# Whoever died of something else may live the next time.
ATTEMPTS = 2


@dataclass(frozen=True)
class Task:
    """What a process does for each source that it is given.

    Parameters
    ----------
    answer : callable
        Takes a source and the request, such as `verify_file` does. It can be pickled.
    request : AnyRequest
    folder : str
        Where it stands, so that paths mean what they mean to the user.
    """

    answer: Callable[[str, Any], Outcome[Any]]
    request: AnyRequest
    folder: str

    def __call__(self, source: str) -> Outcome[Any]:
        """Answer for a source within limits."""
        try:
            self._enter(source)
            limit_memory()
        except MeshmarkError as error:
            return failed(source, error, self.request)
        return self.answer(source, self.request)

    def _enter(self, source: str) -> None:
        names = (source, *self.request.paths)
        try:
            os.chdir(self.folder)
        except OSError as error:
            if not all(Path(name).is_absolute() for name in names if name is not None):
                told = f"cannot be entered: {error.strerror}"
                raise InputError(told, source=self.folder) from None

    def packed(self) -> bytes:
        """Return it as it is sent: with paths of key files, and without keys."""
        return pickle.dumps(self)

    def apart(self) -> Apart:
        """Return a process that does it, and is given the time that a source may take."""
        return Apart(self.packed(), self.request.timeout)


def answer_apart(apart: Apart, source: str) -> Outcome[Any]:
    """Let a process that does a `Task` answer for a source, and another one if it dies of it."""
    last: MeshmarkError
    for _ in range(ATTEMPTS):
        try:
            outcome: Outcome[Any] = apart(source)
            return outcome
        except TimeLimitError as error:
            last = TimeLimitError(f"{error.message}; --timeout can allow more")
            break
        except (WorkerError, OutputError) as error:
            last = error
    task: Task = pickle.loads(apart.function)
    return failed(source, last, task.request)


def answer_many(sources: Sequence[str], task: Task, jobs: int) -> Generator[Outcome[Any]]:
    """Answer for sources in processes of their own, one at a time in each.

    Parameters
    ----------
    jobs : int
        Processes.

    Yields
    ------
    Outcome
        As they finish, each source's once.

    Raises
    ------
    UsageError
        If their limit of memory makes no sense.
    """
    memory_to_measure()
    processes = [task.apart() for _ in range(min(jobs, len(sources)))]
    waiting: queue.SimpleQueue[str] = queue.SimpleQueue()
    for source in sources:
        waiting.put(source)
    finished: queue.SimpleQueue[Outcome[Any] | BaseException] = queue.SimpleQueue()

    def work(apart: Apart) -> None:
        try:
            with suppress(queue.Empty), apart:
                while True:
                    finished.put(answer_apart(apart, waiting.get_nowait()))
        except BaseException as error:
            finished.put(error)

    threads = [threading.Thread(target=work, args=(apart,), daemon=True) for apart in processes]
    for thread in threads:
        thread.start()
    try:
        for _ in sources:
            outcome = finished.get()
            if isinstance(outcome, BaseException):
                raise outcome
            yield outcome
    finally:
        for apart in processes:
            apart.kill()
        for thread in threads:
            thread.join()
