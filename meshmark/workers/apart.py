"""A process of its own for work that may crash, or be killed: whoever waits for it lives on.

Unlike those of a pool, it can be started anywhere, also where `multiprocessing` allows none, such
as in the worker of a cluster; and where one dies, no other ends with it.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import IO, Any

from meshmark.errors import TimeLimitError, WorkerError
from meshmark.files.temporary import ScratchFolder

# Whoever asks nothing for so long may never again, and forget to say so.
PATIENCE = 120.0  # seconds
NO_MEMORY = 99  # exit code
# What processes of a pool leave behind when theirs is killed is removed, and nobody needs to know.
UNTOLD = "ignore::UserWarning:multiprocessing.resource_tracker"
_LENGTH = struct.Struct("!Q")
# So that a process that does nothing but wait is not given half a gigabyte of buffers.
SPARING = {"OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}


def interpreter_environment(more: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return an environment in which Python finds the modules we do, and needs few threads."""
    return {
        **SPARING,
        **os.environ,
        "PYTHONSAFEPATH": "1",
        "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
        **(more or {}),
    }


class Apart:
    """A process that calls one function for us; where it dies, the next call starts another one.

    A context manager. All but `kill` is for one thread.

    Parameters
    ----------
    function : bytes
        Pickled. The process loads it once.
    seconds : float, optional
        What one call may take; the process, and all that it has started, is ended then.
    """

    def __init__(self, function: bytes, seconds: float | None = None) -> None:
        self.function, self.seconds = function, seconds
        self._process: subprocess.Popen[bytes] | None = None
        # What a process leaves behind that was killed goes with it.
        self._folder: ScratchFolder | None = None
        self._is_killed = False
        self._starting = threading.Lock()

    def __enter__(self) -> Apart:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def __call__(self, item: Any) -> Any:
        """Call the function.

        Raises
        ------
        TimeLimitError
            If it takes longer than it may.
        WorkerError
            If the process dies of it, or is killed meanwhile.
        OutputError
            If there is no place for its temporary files.
        """
        is_new = self._process is None or self._process.poll() is not None
        process = self._started() if is_new else self._process
        assert process is not None
        assert process.stdin is not None
        assert process.stdout is not None
        late = threading.Event()
        try:
            with self._ending(process, late):
                if is_new:
                    _put(process.stdin, self.function)
                _put(process.stdin, pickle.dumps(item))
                return pickle.loads(_get(process.stdout))
        except (OSError, EOFError):
            self.close()
            if late.is_set():
                raise TimeLimitError(f"takes longer than {self.seconds:g} s") from None
            raise WorkerError(_death(process.returncode)) from None

    @contextmanager
    def _ending(self, process: subprocess.Popen[bytes], late: threading.Event) -> Iterator[None]:
        """End a process if the block takes longer than it may, and say so."""
        if self.seconds is None:
            yield
            return

        def end() -> None:
            late.set()
            _end(process)

        timer = threading.Timer(min(self.seconds, threading.TIMEOUT_MAX), end)
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()

    def _started(self) -> subprocess.Popen[bytes]:
        """Start a process, in place of one that had nothing to do for long."""
        self.close()
        with self._starting:
            if self._is_killed:
                raise WorkerError("no process works any more")
            self._folder = ScratchFolder()
            try:
                self._process = subprocess.Popen(
                    [sys.executable, "-P", "-W", UNTOLD, "-m", __name__],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    env=interpreter_environment({"TMPDIR": str(self._folder.path)}),
                    # What it starts is ended with it.
                    process_group=None if sys.platform == "win32" else 0,
                )
            except OSError as error:
                raise WorkerError(f"no process can be started: {error.strerror}") from None
            return self._process

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is None:
            return
        _end(process)
        process.wait()
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):
                pipe.close()  # type: ignore[union-attr]
        assert self._folder is not None
        self._folder.remove()

    def kill(self) -> None:
        """End the process at once, and let nothing be asked any more; for any thread."""
        with self._starting:
            self._is_killed = True
            if self._process is not None:
                _end(self._process)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process, and those that it has started."""
    if sys.platform == "win32":
        process.kill()
    elif process.returncode is None:
        # Nobody else has its number before it is waited for.
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def _death(code: int | None) -> str:
    """Say how a process ended."""
    if code == NO_MEMORY:
        return "the process that works on it needs more memory than it may take"
    if code is None or code >= 0:
        return f"the process that works on it ended with {code}"
    if code == -getattr(signal, "SIGKILL", 0):
        return "the process that works on it was killed, as when memory runs out"
    return f"the process that works on it crashed (signal {-code})"


def _put(pipe: IO[bytes], data: bytes) -> None:
    pipe.write(_LENGTH.pack(len(data)))
    pipe.write(data)
    pipe.flush()


def _get(pipe: IO[bytes]) -> bytes:
    [length] = _LENGTH.unpack(_exactly(pipe, _LENGTH.size))
    return _exactly(pipe, length)


def _exactly(pipe: IO[bytes], n: int) -> bytes:
    data = pipe.read(n)
    if len(data) < n:
        raise EOFError
    return data


def _listen(pipe: IO[bytes], said: queue.SimpleQueue[bytes]) -> None:
    """Hand on what is asked; end, whatever this process is at, with the one that asks."""
    with suppress(EOFError):
        while True:
            said.put(_get(pipe))
    os._exit(1)


def main() -> None:
    """Call a function, as whoever started this process says on stdin."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    # What libraries print is no answer.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    said: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(sys.stdin.buffer, said), daemon=True).start()
    function = pickle.loads(said.get())
    try:
        while True:
            item = pickle.loads(said.get(timeout=PATIENCE))
            _put(answers, pickle.dumps(function(item)))
    except queue.Empty:
        return
    except MemoryError:
        os._exit(NO_MEMORY)


if __name__ == "__main__":
    main()
