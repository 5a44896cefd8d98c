"""Whoever waits is told for what, and for how long."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import threading
from io import StringIO
from pathlib import Path

import pytest

from meshmark.cli import console, main
from meshmark.commands.attack import write_attacked
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import icosphere

VERIFY = ("verify", "ball.usdc", "--key", "k", "--scheme", "cho2007", "--frames", ":")


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """Stand in a folder with a moving ball and a key."""
    V, F = icosphere(3)
    ball = MeshAnimation.from_arrays(
        [V * (1.0 + 0.1 * t) * (1.0, 1.2, 0.8) for t in range(3)], F, prim="/Ball"
    )
    write_attacked(Asset("ball", (ball,), "memory"), tmp_path / "ball.usdc")
    Key(bytes(range(32))).save(tmp_path / "k")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def said_by_verify(monkeypatch, capsys) -> list[str]:
    monkeypatch.setattr(sys, "argv", ["meshmark", *VERIFY])
    with pytest.raises(SystemExit):
        main()
    return capsys.readouterr().err.splitlines()


def test_now_and_then_a_line_tells_of_scheme_mesh_and_frames(folder, monkeypatch, capsys) -> None:
    monkeypatch.setattr(console, "BEAT_EVERY", 0.001)
    beats = [line for line in said_by_verify(monkeypatch, capsys) if " of " in line]
    assert beats[0] == "read ball.usdc: 0 of 1, 0 s"
    tried = [line for line in beats if line.startswith("verify ")]
    assert tried
    assert all(re.fullmatch(r"verify /Ball by cho2007: [0-3] of 3, \d+ s", line) for line in tried)


def test_who_waits_little_is_told_nothing(folder, monkeypatch, capsys) -> None:
    assert not [line for line in said_by_verify(monkeypatch, capsys) if " of 3" in line]


def test_the_time_is_that_of_what_is_tried_now(monkeypatch, capsys) -> None:
    now = [100.0]
    monkeypatch.setattr(console.time, "monotonic", lambda: now[0])
    heartbeat = console.Heartbeat()

    class Ticks(threading.Event):
        left = 3

        def wait(self, timeout: float | None = None) -> bool:
            self.left -= 1
            now[0] += 10.0
            if self.left == 0:
                heartbeat("verify", "/B by apex", 0, 12)
            return self.left < 0

    heartbeat("verify", "/A by apex", 0, 4)
    heartbeat("verify", "/A by apex", 2, 4)
    heartbeat.beat(Ticks())
    assert capsys.readouterr().err.splitlines() == [
        "verify /A by apex: 2 of 4, 10 s",
        "verify /A by apex: 2 of 4, 20 s",
        "verify /B by apex: 0 of 12, 0 s",
    ]


class Terminal(StringIO):
    def isatty(self) -> bool:
        return True


def test_a_bar_below_messages_tells_how_fast_it_goes_and_what_is_left(monkeypatch, capsys) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    shown = Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    with console.batch_progress("verify", 3) as advance:
        console.say("a.usd: marked")
        print("data")
        advance()
        advance()
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.getvalue())
    assert "a.usd: marked" in text
    assert re.search(r"verify .* 2/3 [\d.]+ a minute [\d:]+", text)
    assert capsys.readouterr().out == "data\n"


def test_there_is_no_bar_among_printed_data(monkeypatch) -> None:
    shown, printed = Terminal(), Terminal()
    monkeypatch.setattr(sys, "stderr", shown)
    monkeypatch.setattr(sys, "stdout", printed)
    with console.batch_progress("verify", 3, printing=True) as advance:
        advance()
    assert not shown.getvalue() + printed.getvalue()


@pytest.mark.skipif(os.name != "posix", reason="terminals")
def test_a_terminal_shows_what_is_tried(folder) -> None:
    master, slave = os.openpty()
    command = [sys.executable, "-P", "-m", "meshmark", *VERIFY]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100"}
    with subprocess.Popen(command, stderr=slave, stdout=subprocess.DEVNULL, env=environment) as run:
        os.close(slave)
        shown = b""
        while True:
            try:
                some = os.read(master, 4096)
            except OSError:
                break
            if not some:
                break
            shown += some
    os.close(master)
    assert run.returncode == 1
    assert b"read ball.usdc" in shown
    assert b"verify /Ball by cho2007" in shown
