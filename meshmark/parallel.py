"""Frames in parallel processes, results in order, never more of them in memory than needed."""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, TypeVar

from meshmark.errors import UsageError

Item = TypeVar("Item")
Result = TypeVar("Result")

JOBS_VARIABLE = "MESHMARK_JOBS"
# Starting a worker costs about as much as a few frames.
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
    n_jobs = min(default_jobs() if jobs is None else jobs, len(work))
    if n_jobs <= 1 or len(work) < FEWEST_FOR_WORKERS:
        yield from map(function, work)
        return
    with _pool(n_jobs, function) as pool:
        waiting: deque[Future[Any]] = deque()
        for item in work:
            waiting.append(pool.submit(_call, item))
            if len(waiting) > 2 * n_jobs:
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
