"""Temporary folders are gone with their process, or with the next one where it was killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from meshmark.files.atomic import beside
from meshmark.files.temporary import LOCK, ScratchFolder, TemporaryFolder, shared_folder
from meshmark.workers.scratch import ScratchFile
from usd_stages import nested_references, write_text

pytestmark = pytest.mark.skipif(os.name != "posix", reason="locks and kills")

# Makes a temporary folder with something in it, says so, and waits to be killed.
VICTIM = """
import sys, time
from pathlib import Path
from meshmark.files.temporary import TemporaryFolder
folder = TemporaryFolder(Path(sys.argv[1]), sys.argv[2])
(folder.path / "in").mkdir()
(folder.path / "in" / "arrays").write_text("scratch")
print("ready", flush=True)
time.sleep(600)
"""


@pytest.fixture
def victim(tmp_path):
    """Return a function that starts a process with a temporary folder."""
    started = []

    def start(parent: Path, prefix: str = "meshmark-") -> subprocess.Popen[str]:
        command = [sys.executable, "-c", VICTIM, str(parent), prefix]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        assert started[-1].stdout.readline() == "ready\n"
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def kill(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGKILL)
    process.wait()


@pytest.fixture
def place(tmp_path, monkeypatch) -> Path:
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def test_what_a_killed_process_left_is_removed_by_the_next(place, victim) -> None:
    dead, alive = victim(place), victim(place)
    assert len(list(place.iterdir())) == 2
    kill(dead)
    assert len(list(place.iterdir())) == 2
    folder = TemporaryFolder(place)
    assert len(list(place.iterdir())) == 2
    assert alive.poll() is None
    assert (folder.path / LOCK).exists()
    folder.remove()
    [left] = place.iterdir()
    assert (left / "in" / "arrays").read_text() == "scratch"


def test_the_same_beside_outputs(tmp_path, victim) -> None:
    kill(victim(tmp_path, ".meshmark-"))
    assert list(tmp_path.iterdir())
    with beside(tmp_path / "out") as path:
        path.write_text("whole")
        path.replace(tmp_path / "out")
    assert list(tmp_path.iterdir()) == [tmp_path / "out"]


def test_nothing_else_is_removed(tmp_path, place, victim) -> None:
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / LOCK).write_text("")
    (place / "meshmark-link").symlink_to(precious)
    (place / "meshmark-demo").mkdir()
    (place / "meshmark-file").write_text("")
    (place / "other").mkdir()
    (place / "other" / LOCK).write_text("")
    linked = place / "meshmark-linked"
    linked.mkdir()
    (linked / LOCK).symlink_to(precious / LOCK)
    before = sorted(place.rglob("*"))
    TemporaryFolder(place).remove()
    assert sorted(place.rglob("*")) == before
    assert (precious / LOCK).exists()


def test_a_folder_of_somebody_else_stays(place, victim, monkeypatch) -> None:
    kill(victim(place))
    monkeypatch.setattr(os, "getuid", lambda: 4242)
    TemporaryFolder(place).remove()
    assert list(place.iterdir())


def test_a_fork_does_not_remove_what_its_parent_needs(place) -> None:
    folder = TemporaryFolder(place)
    child = os.fork()
    if child == 0:
        folder.remove()
        os._exit(0)
    os.waitpid(child, 0)
    assert folder.path.is_dir()
    folder.remove()
    assert not folder.path.exists()


def test_one_folder_serves_all_and_goes_with_the_last(place) -> None:
    scratch, folder = ScratchFile.create(2, 3), ScratchFolder()
    assert scratch.path.parent.parent == folder.path.parent == shared_folder().path
    assert len(list(place.iterdir())) == 1
    folder.remove()
    assert scratch.path.exists()
    del scratch
    assert not list(place.iterdir())


def test_a_command_that_was_killed_leaves_nothing_for_good(tmp_path, place) -> None:
    environment = {**os.environ, "TMPDIR": str(place)}
    # Nobody reads this to its end.
    write_text(tmp_path / "a.usda", nested_references(24))
    (tmp_path / "b.usda").write_text(
        '#usda 1.0\n(\n timeCodesPerSecond = 24\n)\ndef Mesh "m" {\n'
        " point3f[] points.timeSamples = {1: [(0,0,0), (1,0,0), (0,1,0)]}\n"
        " int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0, 1, 2]\n}\n"
    )
    command = [sys.executable, "-P", "-m", "meshmark", "inspect"]
    process = subprocess.Popen([*command, "a.usda"], cwd=tmp_path, env=environment)
    end = time.monotonic() + 60.0
    while not list(place.glob("meshmark-*/*/stderr")) and time.monotonic() < end:
        time.sleep(0.05)
    assert process.poll() is None
    kill(process)
    assert list(place.iterdir())
    done = subprocess.run([*command, "b.usda"], cwd=tmp_path, env=environment, check=False)
    assert done.returncode == 1
    assert not list(place.iterdir())
