"""Work in a thread beside what this process does: compiled loops and most of numpy let it run."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from threading import Thread
from typing import TypeVar

Result = TypeVar("Result")


def begin_beside(function: Callable[[], Result]) -> Future[Result]:
    """Begin to call a function in a thread, which ends with the process if nobody waits for it.

    Returns
    -------
    Future
        Its result, or what it raised.
    """
    future: Future[Result] = Future()

    def work() -> None:
        try:
            future.set_result(function())
        except Exception as error:
            future.set_exception(error)

    Thread(target=work, name="meshmark-beside", daemon=True).start()
    return future
