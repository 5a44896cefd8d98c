"""A process that may die, and another one after it."""

from __future__ import annotations

import os
import pickle
import select
import sys
import tempfile
import threading
import time

import pytest

from meshmark.errors import TimeLimitError, WorkerError
from meshmark.workers.apart import Apart


def test_it_answers_dies_and_answers_again() -> None:
    with Apart(pickle.dumps(eval)) as apart:
        pid, where = apart("__import__('os').getpid(), __import__('tempfile').gettempdir()")
        assert pid != os.getpid()
        assert where.startswith(tempfile.gettempdir())
        # What is printed is no answer; a large answer is one.
        assert apart("print('x' * 100_000) or 'y' * 100_000") == "y" * 100_000
        assert apart("__import__('os').getpid()") == pid
        with pytest.raises(WorkerError, match="was killed, as when memory runs out"):
            apart("__import__('os').kill(__import__('os').getpid(), 9)")
        with pytest.raises(WorkerError, match="ended with 7"):
            apart("__import__('os')._exit(7)")
        with pytest.raises(WorkerError, match="needs more memory"):
            apart("bytearray(1 << 62)")
        assert apart("__import__('os').getpid()") != pid
    # What they left behind is gone with them.
    assert not os.path.exists(where)  # noqa: PTH110


@pytest.mark.skipif(sys.platform == "win32", reason="there, others end by themselves")
def test_what_takes_too_long_is_ended_with_all_it_started(tmp_path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    descriptor = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    with Apart(pickle.dumps(eval)) as apart, os.fdopen(descriptor, "rb") as reading:
        opened = f"open({str(pipe)!r}, 'w')"
        apart(f"__import__('subprocess').Popen(['sleep', '60'], stdout={opened}) and None")
        assert not select.select([reading], [], [], 0)[0]
        # Not before, because to start may take long.
        apart.seconds = 0.2
        with pytest.raises(TimeLimitError, match="takes longer"):
            apart("__import__('time').sleep(60)")
        # Nobody has it open any more.
        assert select.select([reading], [], [], 30)[0]
        assert reading.read() == b""
        apart.seconds = None
        assert apart("1 + 1") == 2


def test_any_thread_can_end_it() -> None:
    with Apart(pickle.dumps(time.sleep)) as apart:
        apart(0)
        threading.Timer(0.1, apart.kill).start()
        with pytest.raises(WorkerError):
            apart(60)
        with pytest.raises(WorkerError, match="no process works any more"):
            apart(0)
