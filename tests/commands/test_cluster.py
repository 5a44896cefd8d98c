"""Many copies verified on a Dask cluster of real processes."""

from __future__ import annotations

import json
import logging
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from command_line import command
from long_sources import slow_to_measure
from meshmark.commands import cluster
from meshmark.commands.attack import write_attacked
from meshmark.keys import Key
from meshmark.ledger.store import init
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.testing.meshes import icosphere
from meshmark_plugins.readers.obj_write import write_new

MANY = 24
VERIFY = ("verify", "suspects", "--key", "k", "--scheme", "cho2007", "--trusted", "--jsonl")


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    """Stand beside a folder of suspects."""
    monkeypatch.chdir(tmp_path)
    Key(bytes(range(32))).save(tmp_path / "k")
    (tmp_path / "suspects").mkdir()
    (tmp_path / "suspects" / "bad.glb").write_text("not at all")
    return tmp_path


@pytest.fixture
def two_workers() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        dashboard_address=None,
        silence_logs=logging.CRITICAL,
    ) as made:
        yield made


@pytest.mark.slow
def test_nothing_is_lost_and_nothing_twice_when_a_worker_dies(
    folder, two_workers, monkeypatch, capsys
) -> None:
    ball = Asset("ball", (MeshAnimation.from_arrays(*icosphere(1)),), "memory")
    for i in range(MANY):
        write_new(ball, folder / "suspects" / f"walk_{i}")
    answers = folder / "answers"
    killed: list[int] = []

    def kill() -> None:
        while not answers.exists() or answers.read_text().count("\n") < MANY // 3:
            time.sleep(0.05)
        killed.append(next(iter(two_workers.workers.values())).pid)
        os.kill(killed[0], signal.SIGKILL)

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    address = two_workers.scheduler_address
    code = command(monkeypatch, *VERIFY, "--resume", "answers", "--scheduler", address)
    assert code == 3
    killer.join()
    printed = capsys.readouterr()
    assert printed.out == answers.read_text()
    assert Key.load(folder / "k").secret.hex() not in printed.out + printed.err
    lines = [json.loads(line) for line in printed.out.splitlines()]
    named = sorted(f"suspects/{path.name}" for path in (folder / "suspects").iterdir())
    assert sorted(line["source"] for line in lines) == named
    # The same as without a cluster.
    command(monkeypatch, *VERIFY)
    alone = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    for line in (*lines, *alone):
        line.pop("elapsed_s", None)
    assert sorted(lines, key=lambda line: line["source"]) == alone


@pytest.mark.slow
def test_a_worker_gives_up_what_takes_too_long(folder, two_workers, monkeypatch, capsys) -> None:
    write_new(as_asset(MeshAnimation.from_arrays(*icosphere(1))), folder / "suspects" / "walk")
    write_attacked(slow_to_measure(), folder / "suspects" / "long.usdc")
    words = ("verify", "suspects", "--key", "k", "--scheme", "apex", "--frames", ":", "--jsonl")
    address = two_workers.scheduler_address
    assert command(monkeypatch, *words, "--timeout", "15", "--scheduler", address) == 3
    lines = {line["source"]: line for line in map(json.loads, capsys.readouterr().out.splitlines())}
    assert sorted(lines) == ["suspects/bad.glb", "suspects/long.usdc", "suspects/walk"]
    assert lines["suspects/long.usdc"]["timeout"] == 15
    assert lines["suspects/walk"]["verdict"] == "inconclusive"


@pytest.mark.slow
def test_a_cluster_identifies(folder, two_workers, monkeypatch, capsys) -> None:
    init("ledger")
    monkeypatch.setenv("MESHMARK_KEYS", "keys")
    Path("keys").mkdir()
    Key(bytes(range(32))).save(Path("keys/k.key"))
    write_new(as_asset(MeshAnimation.from_arrays(*icosphere(1))), folder / "suspects" / "walk")
    words = ("identify", "suspects", "--ledger", "ledger", "--jsonl", "--trusted")
    assert command(monkeypatch, *words, "--scheduler", two_workers.scheduler_address) == 3
    lines = {line["source"]: line for line in map(json.loads, capsys.readouterr().out.splitlines())}
    assert sorted(lines) == ["suspects/bad.glb", "suspects/walk"]
    assert lines["suspects/walk"]["verdict"] == "inconclusive"


def test_what_is_needed_is_told(folder, monkeypatch, capsys) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert command(monkeypatch, *VERIFY, "--scheduler", "tcp://localhost:8786") == 2
    told = capsys.readouterr().err
    assert told.splitlines()[0].startswith("error: --scheduler needs Dask")
    assert 'pip install "meshmark[dask]"' in told


@pytest.mark.parametrize("address", ["nonsense", "http://localhost:80", "tcp://localhost", ""])
def test_addresses_that_are_none_are_refused(folder, monkeypatch, capsys, address) -> None:
    pytest.importorskip("distributed")
    assert command(monkeypatch, *VERIFY, "--scheduler", address) == 2
    assert "--scheduler takes tcp://HOST:PORT" in capsys.readouterr().err


def test_a_scheduler_that_does_not_answer_is_waited_for_in_vain(
    folder, monkeypatch, capsys
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "TO_CONNECT", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        assert command(monkeypatch, *VERIFY, "--scheduler", address) == 3
    assert capsys.readouterr().err == f"error: {address}: no scheduler answers there\n"


@pytest.mark.parametrize(
    ("more", "said"),
    [(("--jobs", "2"), "no --jobs"), (("--commands", "farm"), "no --json or --scheduler")],
)
def test_who_does_the_work_is_said_once(folder, monkeypatch, capsys, more, said) -> None:
    assert command(monkeypatch, *VERIFY, "--scheduler", "tcp://localhost:8786", *more) == 2
    assert said in capsys.readouterr().err
