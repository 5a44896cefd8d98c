"""Work in a thread beside what this process does: compiled loops and most of numpy let it run."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from concurrent.futures import Future
from threading import Thread
from typing import Generic, TypeVar

Result = TypeVar("Result")


class Beside(Generic[Result]):
    """A function that a thread calls from now on, until somebody asks for what it returns.

    Parameters
    ----------
    function : callable
        Called without arguments.
    """

    def __init__(self, function: Callable[[], Result]) -> None:
        self._function = function
        self._future: Future[Result] = Future()
        self._thread = Thread(target=self._work, name="meshmark-beside")
        self._thread.start()

    def result(self) -> Result:
        """Wait for what the function returns, or raises."""
        return self._future.result()

    def end(self) -> None:
        """End it before its next step in Python, and wait for that: nothing may run at exit."""
        if self._thread.is_alive():
            thread = ctypes.c_ulong(self._thread.ident or 0)
            ctypes.pythonapi.PyThreadState_SetAsyncExc(thread, ctypes.py_object(SystemExit))
        self._thread.join()

    def _work(self) -> None:
        try:
            self._future.set_result(self._function())
        except Exception as error:
            self._future.set_exception(error)
        except SystemExit:
            self._future.cancel()
