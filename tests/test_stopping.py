"""Commands that are told to end: promptly, in one line, and with nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from meshmark.animation import Asset, MeshAnimation
from meshmark.attacking import write_attacked
from meshmark.cli.stopping import Stopped, stopping
from meshmark.demo import creature as build_creature
from meshmark.keys import Key

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals and groups of processes")

# The same worker processes first tell who they are, then sleep.
SLEEPERS = """
from time import sleep
from meshmark.parallel import ordered_map, shared_workers
with shared_workers(2):
    list(ordered_map(eval, ["__import__('time').sleep(0.2)"] * 8, jobs=2))
    print("at work", flush=True)
    list(ordered_map(sleep, [600.0, 600.0], jobs=2))
"""


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
    return False


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
def studio(tmp_path) -> Path:
    """Return a folder with a small creature, a key, and an empty folder for scratch files."""
    animation: MeshAnimation = build_creature(points=3000, frames=8)
    write_attacked(Asset("creature", (animation,), "memory"), tmp_path / "creature.usdc")
    Key(bytes(range(32))).save(tmp_path / "k")
    (tmp_path / "scratch").mkdir()
    return tmp_path


def test_a_terminated_command_leaves_nothing_behind(start, studio) -> None:
    before = sorted(studio.iterdir())
    command = ("-m", "meshmark", "embed", "creature.usdc", "-o", "marked.usdc", "--key", "k")
    environment = {**os.environ, "TMPDIR": str(studio / "scratch"), "MESHMARK_JOBS": "2"}
    embed = start(*command, cwd=studio, env=environment, stderr=subprocess.PIPE)
    assert until(lambda: any((studio / "scratch").glob("meshmark-*/*")))
    embed.terminate()
    told = embed.communicate(timeout=60)[1]
    assert embed.returncode == 128 + signal.SIGTERM
    assert told == "error: stopped by SIGTERM\n"
    assert until(lambda: group_is_gone(embed.pid))
    assert sorted(studio.iterdir()) == before
    assert not any((studio / "scratch").iterdir())


def test_workers_end_with_a_parent_that_was_killed(start) -> None:
    parent = start("-c", SLEEPERS, stdout=subprocess.PIPE)
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


def test_what_is_ignored_stays_so() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stopping():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
