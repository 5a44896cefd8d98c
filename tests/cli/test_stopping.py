"""Commands that are told to end: promptly, in one line, and with nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from meshmark.cli.stopping import Stopped, stopping
from meshmark.commands.attack import write_attacked
from meshmark.keys import Key
from meshmark.mesh.asset import Asset

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and groups of processes")

# The same worker processes first tell who they are, then sleep.
SLEEPERS = """
from time import sleep
from meshmark.workers.ordered_map import ordered_map, shared_workers
with shared_workers(2):
    list(ordered_map(eval, ["__import__('time').sleep(0.2)"] * 8, jobs=2))
    print("at work", flush=True)
    list(ordered_map(sleep, [600.0, 600.0], jobs=2))
"""

# A signal arrives when a worker has just been started, and waits for its orders.
UNLUCKY = """
import os, sys
from multiprocessing import util
from signal import {name}
from time import sleep
import meshmark.cli

start = util.spawnv_passfds

def start_and_be_told(path, arguments, descriptors):
    started = start(path, arguments, descriptors)
    if "--multiprocessing-fork" in str(arguments):
        os.kill(os.getpid(), {name})
        sleep(0.5)
    return started

util.spawnv_passfds = start_and_be_told
sys.argv = ["meshmark", *sys.argv[1:]]
meshmark.cli.main()
"""
EMBED = ("embed", "creature.usdc", "-o", "marked.usdc", "--key", "k")


def until(true: Callable[[], bool], seconds: float = 60.0) -> bool:
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.05)
    return true()


def group_is_gone(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    # Those that have ended may wait for somebody to ask how; not every system's first process does.
    states = [state for state, owner in states_and_groups() if owner == group]
    return bool(states) and set(states) == {"Z"}


def states_and_groups() -> Iterator[tuple[str, int]]:
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, group = stat.read_text().rpartition(")")[2].split()[:3]
            yield state, int(group)


@pytest.fixture
def start() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Start Python in a group of processes of its own, of which none is left in the end."""
    started = []

    def call(*arguments: str, **options: Any) -> subprocess.Popen[str]:
        command = [sys.executable, *arguments]
        started.append(subprocess.Popen(command, text=True, start_new_session=True, **options))
        return started[-1]

    yield call
    for process in started:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@pytest.fixture
def studio(tmp_path, creature) -> Path:
    """Return a folder with the creature, a key, and an empty folder for scratch files."""
    write_attacked(Asset("creature", (creature,), "memory"), tmp_path / "creature.usdc")
    Key(bytes(range(32))).save(tmp_path / "k")
    (tmp_path / "scratch").mkdir()
    return tmp_path


@pytest.fixture
def embed(start, studio) -> Callable[..., subprocess.Popen[str]]:
    """Start an embedding of the creature by two workers, after given arguments to Python."""
    environment = {**os.environ, "TMPDIR": str(studio / "scratch"), "MESHMARK_JOBS": "2"}

    def call(*arguments: str) -> subprocess.Popen[str]:
        return start(*arguments, *EMBED, cwd=studio, env=environment, stderr=subprocess.PIPE)

    return call


def has_begun(studio: Path) -> bool:
    return any((studio / "scratch").glob("meshmark-*/*"))


def assert_stopped(process: subprocess.Popen[str], name: str, studio: Path) -> None:
    told = process.communicate(timeout=240)[1]
    assert told == f"error: stopped by {name}\n"
    assert process.returncode == 128 + getattr(signal, name)
    assert until(lambda: group_is_gone(process.pid))
    assert sorted(p.name for p in studio.iterdir()) == ["creature.usdc", "k", "scratch"]
    assert not any((studio / "scratch").iterdir())


def test_a_terminated_command_leaves_nothing_behind(embed, studio) -> None:
    process = embed("-m", "meshmark")
    assert until(lambda: has_begun(studio))
    process.terminate()
    assert_stopped(process, "SIGTERM", studio)


@pytest.mark.parametrize("name", ["SIGINT", "SIGHUP"])
def test_a_signal_to_the_whole_group_is_told_of_once(embed, studio, name) -> None:
    process = embed("-m", "meshmark")
    assert until(lambda: has_begun(studio))
    for _ in range(3):
        os.killpg(process.pid, getattr(signal, name))
    assert_stopped(process, name, studio)


def test_a_worker_that_is_being_started_says_nothing(embed, studio) -> None:
    assert_stopped(embed("-c", UNLUCKY.format(name="SIGTERM")), "SIGTERM", studio)


def test_workers_end_with_a_parent_that_was_killed(start, tmp_path) -> None:
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    parent = start("-c", SLEEPERS, stdout=subprocess.PIPE, env=environment)
    assert parent.stdout.readline() == "at work\n"
    parent.kill()
    parent.wait()
    assert until(lambda: group_is_gone(parent.pid), 20.0)


def test_signals_mean_what_they_did_before_again() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(Stopped, match="SIGTERM") as stop, stopping():
        signal.raise_signal(signal.SIGTERM)
    assert stop.value.exit_code == 143
    assert signal.getsignal(signal.SIGTERM) is before


def stopped(work: Callable[[], None]) -> Stopped:
    """Do what is to be stopped, and wait for that a while if need be."""
    try:
        with stopping():
            work()
            until(lambda: False)
    except Stopped as stop:
        return stop
    pytest.fail("was not stopped")


def test_the_making_of_a_temporary_file_is_not_cut_short(tmp_path, monkeypatch) -> None:
    opened = os.open

    def open_and_be_told(*arguments: Any) -> int:
        handle = opened(*arguments)
        signal.raise_signal(signal.SIGTERM)
        return handle

    def make_a_file_and_remove_it() -> None:
        handle, name = tempfile.mkstemp(dir=tmp_path)
        monkeypatch.undo()
        os.close(handle)
        Path(name).unlink()

    monkeypatch.setattr(os, "open", open_and_be_told)
    stopped(make_a_file_and_remove_it)
    assert not any(tmp_path.iterdir())


def test_what_is_swallowed_is_raised_again() -> None:
    def swallow() -> None:
        with suppress(Stopped):
            signal.raise_signal(signal.SIGTERM)

    stopped(swallow)


def test_tidying_is_not_cut_short_by_being_told_again() -> None:
    tidied = []

    def tidy_up() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGTERM)
            tidied.append(True)

    assert str(stopped(tidy_up)) == "stopped by SIGINT"
    assert tidied


def test_what_fails_because_it_was_stopped_is_stopped() -> None:
    def fail() -> None:
        raise ImportError("initialization failed")

    def fail_when_stopped() -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except Stopped:
            fail()

    stopped(fail_when_stopped)
    with pytest.raises(ImportError), stopping():
        fail()


def test_what_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stopping():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
