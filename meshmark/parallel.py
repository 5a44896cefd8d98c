"""Frames in parallel processes, results in order, never more of them in memory than needed."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from typing import Any, Generic, TypeVar

from meshmark.errors import UsageError

Item = TypeVar("Item")
Result = TypeVar("Result")

JOBS_VARIABLE = "MESHMARK_JOBS"
FEWEST_FOR_WORKERS = 4


def default_jobs() -> int:
    """Return the number of worker processes: MESHMARK_JOBS, or one for each processor."""
    text = os.environ.get(JOBS_VARIABLE)
    if text is None:
        return (
            len(os.sched_getaffinity(0))
            if hasattr(os, "sched_getaffinity")
            else os.cpu_count() or 1
        )
    if not text.isdigit() or int(text) < 1:
        raise UsageError(f"{JOBS_VARIABLE} must be a whole number from 1, not {text!r}")
    return int(text)


def ordered_map(
    function: Callable[[Item], Result], items: Iterable[Item], *, jobs: int | None = None
) -> Iterator[Result]:
    """Apply a picklable function to items in worker processes, results in the items' order.

    Parameters
    ----------
    function : callable
        Sent to each worker once.
    items : iterable
        Small things such as frame indices; consumed only as fast as results are taken.
    jobs : int, optional
        Worker processes; 1 works in this process.
    """
    work = list(items)
    n_jobs = default_jobs() if jobs is None else jobs
    # Starting a worker costs about as much as a few frames.
    with Workers(
        function, min(n_jobs, len(work)) if len(work) >= FEWEST_FOR_WORKERS else 1
    ) as workers:
        yield from workers.map(work)


class Workers(Generic[Item, Result]):
    """Worker processes that stay, for work that comes in rounds; a context manager.

    Parameters
    ----------
    function : callable
        Picklable; sent to each worker once.
    jobs : int
        Worker processes; 1 works in this process.
    """

    def __init__(self, function: Callable[[Item], Result], jobs: int) -> None:
        self._function, self._jobs = function, jobs
        self._stack = ExitStack()
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Workers[Item, Result]:
        if self._jobs > 1:
            self._pool = self._stack.enter_context(_pool(self._jobs, self._function))
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def map(self, items: Iterable[Item]) -> Iterator[Result]:
        """Apply the function to items, which are consumed only as fast as results are taken."""
        if self._pool is None:
            yield from map(self._function, items)
            return
        waiting: deque[Future[Any]] = deque()
        for item in items:
            waiting.append(self._pool.submit(_call, item))
            if len(waiting) > 2 * self._jobs:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()


@contextmanager
def _pool(n_jobs: int, function: Callable[[Any], Any]) -> Iterator[ProcessPoolExecutor]:
    # Forking a process in which open3d or pxr has started threads may dead-lock.
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(n_jobs, context, initializer=_install, initargs=(function,))
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


_function: Callable[[Any], Any] | None = None


def _install(function: Callable[[Any], Any]) -> None:
    global _function
    _function = function


def _call(item: Any) -> Any:
    assert _function is not None
    return _function(item)
