"""Worker processes: how they start, find the functions they are to call, and end."""

from __future__ import annotations

import atexit
import gc
import importlib
import multiprocessing
import os
import pickle
import signal
import sys
import tempfile
import threading
import weakref
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_limits

from meshmark.errors import OutputError, UsageError
from meshmark.files.temporary import ScratchFolder

# Linux writes up to 4096 bytes in one piece; beside a result, some words about it are sent.
SHORT = 2048  # bytes


class Pool:
    """Worker processes, and a folder in which they find the functions they are to call.

    Parameters
    ----------
    jobs : int
        Processes; they start as they are needed.
    """

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self.is_abandoned = False
        self._folder: ScratchFolder | None = None
        self._count = 0
        # Forking a process in which open3d or pxr has started threads may dead-lock.
        self._context = multiprocessing.get_context("spawn")
        self._executor: ProcessPoolExecutor | None = None
        self._starts: list[Future[Any]] = []
        # Python throws what signals mean into its main thread, wherever that is: a worker it was
        # about to start would wait for its orders in vain, and say so.
        self._starter = ThreadPoolExecutor(1, "meshmark-starter", _hold_signals)
        self._theirs, self._lifeline = self._context.Pipe(duplex=False)
        _pools.add(self)

    @property
    def is_running(self) -> bool:
        """Whether worker processes have been started."""
        return self._executor is not None

    def keep(self, function: Callable[[Any], Any]) -> Path | bytes:
        """Write a function down for the workers; where nothing can be written, keep it as bytes."""
        pickled = pickle.dumps(function)
        try:
            if self._folder is None:
                self._folder = ScratchFolder()
            self._count += 1
            path = self._folder.path / str(self._count)
            path.write_bytes(pickled)
        except (OSError, OutputError):
            return pickled
        return path

    def start(self, function: Callable[..., object], *arguments: object) -> None:
        """Start the processes, unless they run; a function gets them ready.

        Raises
        ------
        BrokenProcessPool
            If all are to end.
        """
        if self._executor is None:
            self._starts = [self._ask(function, *arguments) for _ in range(self._jobs)]

    def count_ready(self) -> int:
        """Count the processes that are ready."""
        return sum(each.done() for each in self._starts)

    def submit(self, kept: Path | bytes, item: Any) -> Future[Any]:
        """Let a worker call a function that was kept.

        Raises
        ------
        BrokenProcessPool
            If a worker has died, or all are to end.
        """
        return self._ask(_call, kept, item)

    def _ask(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        return self._starter.submit(self._submit, function, *arguments).result()

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        if self.is_abandoned:
            raise BrokenProcessPool("abandoned")
        if self._executor is None:
            # It is to outlive us whatever comes, but looks after two of the three signals only,
            # and lets those through again.
            with safe_path():
                resource_tracker.ensure_running()
            _hold_signals()
            self._executor = ProcessPoolExecutor(self._jobs, self._context, _begin, (self._theirs,))
        with safe_path():
            return self._executor.submit(function, *arguments)

    def result(self, future: Future[Any]) -> Any:
        """Wait for what a submitted call returns.

        Raises
        ------
        BrokenProcessPool
            If a worker has died, or all are to end.
        """
        answer = future.result()
        if not isinstance(answer, _Left):
            return answer
        data = answer.path.read_bytes()
        answer.path.unlink()
        return pickle.loads(data)

    def drop(self, futures: Iterable[Future[Any]]) -> None:
        """Forget calls that nobody wants the results of any more, and wait for those begun."""
        # Futures of a pool that breaks must not be cancelled meanwhile: it complains.
        begun = [f for f in futures if self.is_abandoned or not f.cancel()]
        for future in wait(begun).done:
            if future.exception() is None and isinstance(future.result(), _Left):
                future.result().path.unlink()

    def restart(self) -> None:
        """Start other workers when next asked: one of these died, and the rest end with it."""
        # By the thread that starts them, so that nothing is asked of them meanwhile.
        self._starter.submit(self._end_executor, cancel=not self.is_abandoned).result()

    def _end_executor(self, cancel: bool) -> None:
        executor, self._executor = self._executor, None
        if executor is not None:
            executor.shutdown(wait=True, cancel_futures=cancel)

    def abandon(self) -> None:
        """End the workers at once."""
        self.is_abandoned = True
        self._lifeline.close()

    def close(self) -> None:
        """Let the workers end."""
        self._starter.shutdown(wait=True)
        self._end_executor(cancel=not self.is_abandoned)
        self._lifeline.close()
        self._theirs.close()
        if self._folder is not None:
            self._folder.remove()


# Those that may have workers.
_pools: weakref.WeakSet[Pool] = weakref.WeakSet()


def abandon_workers() -> None:
    """End all worker processes at once, whatever they are at; for when everything is to end."""
    for pool in list(_pools):
        pool.abandon()


_SAFE_PATH = "PYTHONSAFEPATH"
_starting = threading.Lock()


@contextmanager
def safe_path() -> Iterator[None]:
    """Keep the working directory off the import path of processes started meanwhile.

    Python puts it there first for `python -c`, which is how `multiprocessing` starts its own. Who
    is asked about a leaked copy often stands in the folder it came in, beside what else is there.

    Raises
    ------
    UsageError
        If this Python was told not to look at the environment: nor would those it starts.
    """
    if sys.flags.ignore_environment and not sys.flags.safe_path:
        raise UsageError("`python -E` lets workers import from the working directory; add -P")
    with _starting:
        before = os.environ.get(_SAFE_PATH)
        os.environ[_SAFE_PATH] = "1"
        try:
            yield
        finally:
            if before is None:
                del os.environ[_SAFE_PATH]
            else:
                os.environ[_SAFE_PATH] = before


def one_thread() -> threadpool_limits:
    """Keep linear algebra to one thread, until the returned context ends or for good."""
    return threadpool_limits(limits=1, user_api="blas")


if sys.platform != "win32":
    _HELD = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def _hold_signals() -> None:
    """Keep signals from this thread, and from processes it starts until they let them through."""
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_BLOCK, _HELD)


def _begin(lifeline: Connection) -> None:
    """Let this worker end when it is told to, or with the holder of its lifeline.

    A process that is killed cannot tell its workers: they would wait for work for ever.
    """
    # Not with a traceback from wherever it is: a terminal sends this to the workers, too.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _HELD)
    threading.Thread(target=_watch, args=(lifeline,), daemon=True).start()
    # Or else, in the end, Python looks for garbage among all that was imported.
    atexit.register(gc.freeze)


def _watch(lifeline: Connection) -> None:
    lifeline.poll(None)
    os._exit(1)


@dataclass(frozen=True)
class _Left:
    """Where a worker has left a result."""

    path: Path


def load(kept: Path | bytes) -> None:
    """Get a worker ready to call a function that was kept."""
    _function(kept)


def import_all(modules: Sequence[str]) -> None:
    """Get a worker ready for what needs some modules."""
    for name in modules:
        importlib.import_module(name)


def _call(kept: Path | bytes, item: Any) -> Any:
    """Call a function that was kept; leave what it returns in a file, unless that is short.

    Of a worker that is ended while it writes into the pipe between us, we would wait for the rest
    for ever. What is short is written in one piece, or not at all.
    """
    result = _function(kept)(item)
    if not isinstance(kept, Path):
        return result
    data = pickle.dumps(result, protocol=pickle.HIGHEST_PROTOCOL)
    return result if len(data) <= SHORT else _left(data, kept.parent, result)


def _left(data: bytes, folder: Path, result: Any) -> Any:
    try:
        handle, name = tempfile.mkstemp(dir=folder)
        path = Path(name)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(data)
        except OSError:
            path.unlink()
            raise
    except OSError:
        # Such as that of a full disk.
        return result
    return _Left(path)


@lru_cache(maxsize=2)
def _function(kept: Path | bytes) -> Callable[[Any], Any]:
    pickled = kept.read_bytes() if isinstance(kept, Path) else kept
    function: Callable[[Any], Any] = pickle.loads(pickled)
    # Only libraries that are loaded by now know of it.
    one_thread()
    return function
