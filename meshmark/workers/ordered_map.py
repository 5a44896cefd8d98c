"""Frames in parallel processes, results in order, never more of them in memory than needed."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager, suppress
from functools import partial, wraps
from itertools import islice
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

from meshmark.errors import UsageError, WorkerError
from meshmark.workers.pool import Pool, import_all, load, one_thread

Item = TypeVar("Item")
Result = TypeVar("Result")
Arguments = ParamSpec("Arguments")

JOBS_VARIABLE = "MESHMARK_JOBS"
# Starting workers costs about as much as a few frames, or where it is known what those take, as so
# many seconds.
FEWEST_FOR_NEW_WORKERS, FEWEST_FOR_WORKERS = 4, 2
TO_START = 2.0
# Items of light work that are tried before workers are started: the first has to import things.
TRIED = 2


def default_jobs() -> int:
    """Return the number of processes to work in: MESHMARK_JOBS, or one for each processor."""
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
    function: Callable[[Item], Result],
    items: Iterable[Item],
    *,
    jobs: int | None = None,
    seconds: float | None = None,
    light: bool = False,
) -> Iterator[Result]:
    """Apply a picklable function to items in worker processes, results in the items' order.

    Parameters
    ----------
    function : callable
        Sent to each worker once.
    items : iterable
        Small things such as frame indices; consumed only as fast as results are taken.
    jobs : int, optional
        Processes, this one included.
    seconds : float, optional
        Of CPU time that an item takes in this process, if that is known.
    light : bool
        Whether items may take so little that workers are not worth starting: unless some run, the
        first items are worked on in this process, to see.
    """
    work = list(items)
    n_jobs = default_jobs() if jobs is None else jobs
    if light and n_jobs > 1 and not _are_running():
        for item in work[:TRIED]:
            start = time.process_time()
            yield function(item)
            seconds = time.process_time() - start
        work = work[TRIED:]
    if not _are_worth_it(len(work), seconds):
        n_jobs = 1
    with Workers(function, min(n_jobs, len(work)) or 1) as workers:
        yield from workers.map(work)


def _are_worth_it(n_items: int, seconds: float | None) -> bool:
    """Tell whether worker processes have enough to do, those that run already included."""
    if _are_running():
        return n_items >= FEWEST_FOR_WORKERS
    if seconds is None:
        return n_items >= FEWEST_FOR_NEW_WORKERS
    return n_items >= FEWEST_FOR_WORKERS and n_items * seconds >= TO_START


def _are_running() -> bool:
    return _shared.pool is not None and _shared.pool.is_running


@contextmanager
def shared_workers(jobs: int) -> Iterator[None]:
    """Let everything done in parallel meanwhile share worker processes.

    Starting them, and importing what they need, costs a second or so each time; they start when
    first needed. Within a block of this kind another one changes nothing.

    Linear algebra keeps to one thread meanwhile, here and in the workers: its threads would
    only get in the way of the processes, and sums would depend on how many there are.

    Parameters
    ----------
    jobs : int
        Processes, this one included.
    """
    if _shared.pool is not None:
        yield
        return
    pool = Pool(jobs - 1)
    _shared.pool = pool if jobs > 1 else None
    try:
        with one_thread():
            yield
    finally:
        _shared.pool = None
        pool.close()


def prepare_workers(modules: Sequence[str], n_items: int) -> None:
    """Start the shared workers before there is work, if they are worth it for so many items.

    Parameters
    ----------
    modules : sequence of str
        What they will need.
    """
    if _shared.pool is not None and n_items >= FEWEST_FOR_NEW_WORKERS:
        with suppress(BrokenProcessPool):
            _shared.pool.start(import_all, modules)


def sharing_workers(function: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Let all that a function of a keyword argument `jobs` does in parallel share workers."""

    @wraps(function)
    def sharing(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        jobs = kwargs.get("jobs", 1)
        assert isinstance(jobs, int)
        with shared_workers(jobs):
            return function(*args, **kwargs)

    return sharing


class Workers(Generic[Item, Result]):
    """Processes that stay, for work that comes in rounds; a context manager.

    Parameters
    ----------
    function : callable
        Picklable; sent to each worker once.
    jobs : int
        Processes, this one included: it works on items itself while others do, and on all of them
        until those have started. Within `shared_workers`, they are its own.
    """

    def __init__(self, function: Callable[[Item], Result], jobs: int) -> None:
        self._function, self._jobs = function, jobs
        self._pool: Pool | None = None
        self._kept: Path | bytes = b""
        self._limits = ExitStack()
        self._begun: list[Future[Any]] = []

    @property
    def are_ready(self) -> bool:
        """Whether a process beside this one is."""
        return self._pool is not None and self._pool.count_ready() > 0

    def __enter__(self) -> Workers[Item, Result]:
        if self._jobs > 1:
            if _shared.pool is None:
                # Sums depend on how many threads there are.
                self._limits.enter_context(one_thread())
            self._pool = _shared.pool or Pool(self._jobs - 1)
            self._kept = self._pool.keep(self._function)
        return self

    def __exit__(self, *exception: object) -> None:
        self._limits.close()
        if self._pool is not None:
            self._pool.drop(self._begun)
        if self._pool is not None and self._pool is not _shared.pool:
            self._pool.close()
        elif isinstance(self._kept, Path):
            self._kept.unlink()

    def map(self, items: Iterable[Item]) -> Iterator[Result]:
        """Apply the function to items, which are consumed only as fast as results are taken.

        Raises
        ------
        WorkerError
            If a worker is killed, or crashes.
        """
        if self._pool is None:
            yield from map(self._function, items)
            return
        # In the items' order: those that workers have, and those that were worked on here.
        waiting: deque[Future[Any]] = deque()
        try:
            self._pool.start(load, self._kept)
            rest = _Rest(items)
            while rest.has() or waiting:
                self._hand_out(rest, self._pool, waiting)
                if waiting and (
                    waiting[0].done() or not rest.has() or len(waiting) > 2 * self._jobs
                ):
                    yield self._pool.result(waiting.popleft())
                else:
                    waiting.append(_done(self._function, rest.take()))
        except BrokenProcessPool:
            raise self._broken(self._pool) from None
        finally:
            self._pool.drop(waiting)

    def begin(self, item: Item) -> Callable[[], Result]:
        """Let a worker begin with an item while this process does something else.

        Returns
        -------
        callable
            Waits for the result, once. Where no worker is ready, it works on the item.

        Raises
        ------
        WorkerError
            If a worker is killed, or crashes.
        """
        pool = self._pool
        if pool is None or not self.are_ready:
            return partial(self._function, item)
        try:
            future = pool.submit(self._kept, item)
        except BrokenProcessPool:
            raise self._broken(pool) from None
        self._begun.append(future)

        def finish() -> Result:
            try:
                found: Result = pool.result(future)
            except BrokenProcessPool:
                raise self._broken(pool) from None
            self._begun.remove(future)
            return found

        return finish

    def _broken(self, pool: Pool) -> WorkerError:
        """Have new workers, and tell that the old ones died."""
        pool.restart()
        return WorkerError(
            "a worker process died, as when memory runs out; "
            f"fewer of them, {JOBS_VARIABLE}=1, need less"
        )

    def _hand_out(self, rest: _Rest[Item], pool: Pool, waiting: deque[Future[Any]]) -> None:
        """Give each worker something to do, and something to do next unless we would be idle."""
        ready, begun = pool.count_ready(), sum(not each.done() for each in waiting)
        for place in range(begun, 2 * ready):
            if not rest.has(1 if place < ready else 2):
                return
            waiting.append(pool.submit(self._kept, rest.take()))


class _Rest(Generic[Item]):
    """The items that nobody has begun, asked for one by one."""

    def __init__(self, items: Iterable[Item]) -> None:
        self._items = iter(items)
        self._next: deque[Item] = deque()

    def has(self, n: int = 1) -> bool:
        """Whether there are so many."""
        self._next.extend(islice(self._items, max(0, n - len(self._next))))
        return len(self._next) >= n

    def take(self) -> Item:
        """Return the first of them, after it was asked whether there is one."""
        return self._next.popleft()


def _done(function: Callable[[Item], Result], item: Item) -> Future[Result]:
    """Call a function; an error is raised in its turn, when the result is asked for."""
    done: Future[Result] = Future()
    try:
        done.set_result(function(item))
    except Exception as error:
        done.set_exception(error)
    return done


class _Shared(threading.local):
    """The processes that all share within `shared_workers`, each thread its own."""

    pool: Pool | None = None


_shared = _Shared()
