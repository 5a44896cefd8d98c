"""Verifies many sources, each in a process that works on nothing else meanwhile."""

from __future__ import annotations

import os
import pickle
import queue
import threading
from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from meshmark.commands.verification import Outcome, Request
from meshmark.commands.verify import verify_file
from meshmark.errors import InputError, MeshmarkError, OutputError, WorkerError
from meshmark.sources.isolation.limits import limit_memory, memory_to_measure
from meshmark.workers.apart import Apart

# Whoever died of something else may live the next time.
ATTEMPTS = 2


@dataclass(frozen=True)
class Task:
    """What a process does for each source that it is given.

    Parameters
    ----------
    request : Request
    folder : str
        Where it stands, so that paths mean what they mean to the user.
    """

    request: Request
    folder: str

    def __call__(self, source: str) -> Outcome:
        """Verify a source within limits."""
        try:
            self._enter(source)
            limit_memory()
        except MeshmarkError as error:
            return failed(source, error, self.request)
        return verify_file(source, self.request)

    def _enter(self, source: str) -> None:
        request = self.request
        names = (source, request.key_file, request.original, request.master, request.store)
        try:
            os.chdir(self.folder)
        except OSError as error:
            if not all(Path(name).is_absolute() for name in names if name is not None):
                told = f"cannot be entered: {error.strerror}"
                raise InputError(told, source=self.folder) from None

    def packed(self) -> bytes:
        """Return it as it is sent: with the path of the key's file, and without the key."""
        return pickle.dumps(self)


def failed(source: str, error: MeshmarkError, request: Request) -> Outcome:
    """Return the outcome where a source could not be worked on at all."""
    asked = request.asked(source) if request.recorded else {}
    told = error.message if error.source is None else str(error)
    return Outcome(source, None, f"{source}: {told}", error.exit_code, (), asked)


def verify_apart(apart: Apart, source: str) -> Outcome:
    """Let a process that does a `Task` verify a source, and another one if it dies of it."""
    for _ in range(ATTEMPTS):
        try:
            outcome: Outcome = apart(source)
            return outcome
        except (WorkerError, OutputError) as error:
            last = error
    task: Task = pickle.loads(apart.function)
    return failed(source, last, task.request)


def verify_many(sources: Sequence[str], request: Request, jobs: int) -> Generator[Outcome]:
    """Verify sources in processes of their own, one at a time in each.

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
    task = Task(request, str(Path.cwd())).packed()
    n = min(jobs, len(sources))
    processes = [Apart(task) for _ in range(n)]
    waiting: queue.SimpleQueue[str] = queue.SimpleQueue()
    for source in sources:
        waiting.put(source)
    finished: queue.SimpleQueue[Outcome | BaseException] = queue.SimpleQueue()

    def work(apart: Apart) -> None:
        try:
            with suppress(queue.Empty), apart:
                while True:
                    finished.put(verify_apart(apart, waiting.get_nowait()))
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
