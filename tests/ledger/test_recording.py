"""A copy and its entry belong together: where one cannot be, neither is."""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from command_line import command
from database_server import Server
from meshmark.commands.attack import write_attacked
from meshmark.embedding import file as marking
from meshmark.embedding.manifest import output_hashes
from meshmark.embedding.undoing import as_they_were
from meshmark.errors import OutputError
from meshmark.keys import Key
from meshmark.ledger import store
from meshmark.ledger.store import Ledger, init
from meshmark.mesh.asset import as_asset
from meshmark.testing.informed_schemes import horned
from small_disk import fill, mounted

LEDGER = "studio.ledger"
MARK = ("embed", "horns.usdc", "--key", "k", "--scheme", "relief", "--trusted")


@pytest.fixture
def studio(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    write_attacked(as_asset(horned()), Path("horns.usdc"))
    Key(bytes(range(32))).save(Path("k"))
    init(LEDGER)
    return tmp_path


@pytest.fixture
def run(studio: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> Callable[..., Any]:
    def call(*arguments: object, ledger: str = LEDGER) -> tuple[int, str, list[str]]:
        code = command(monkeypatch, *arguments, "--ledger", ledger)
        captured = capsys.readouterr()
        return code, captured.out, captured.err.splitlines()

    return call


def state(folder: Path) -> dict[str, bytes]:
    """Return all files but the ledger, and that there are no others."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() if path.is_file() else b""
        for path in sorted(folder.rglob("*"))
        if not path.name.startswith(LEDGER)
    }


def entries(where: str = LEDGER) -> list[dict[str, Any]]:
    ledger = Ledger(where)
    assert not list(ledger.findings())
    return list(ledger.entries())


def failed(outcome: tuple[int, str, list[str]], code: int, *words: str) -> None:
    """Fail unless it ended with a code and one line of error that has these words."""
    got, _, err = outcome
    assert got == code, err
    errors = [line for line in err if line.startswith("error: ")]
    assert len(errors) == 1, err
    assert all(word in errors[0] for word in words), errors
    assert not [line for line in err if "Traceback" in line]


@pytest.mark.slow
def test_embed_records_the_copy_once(run: Callable[..., Any], studio: Path) -> None:
    mark = (*MARK, "-o", "acme.usdc", "--recipient", "Zoe\u0308 张伟 🐎")
    code, _, err = run(*mark)
    assert code == 0
    assert f"{LEDGER}: entry 1 recorded" in err
    [entry] = entries()
    assert entry["manifest"] == json.loads(Path("acme.usdc.meshmark.json").read_text())
    assert entry["recipient"] == "Zoë 张伟 🐎"
    assert entry["asset"] == "horns"
    assert entry["version"] == entry["manifest"]["source"]["files"][0]["sha256"][:12]
    assert entry["output"] == str(studio / "acme.usdc")
    assert entry["key_id"] == Key(bytes(range(32))).id
    code, _, err = run(*mark)
    assert code == 0
    assert f"{LEDGER}: entry 1 was recorded before" in err
    named = ("--asset", "horns hero", "--asset-version", "v012")
    assert run(*MARK, "-o", "globex.usdc", "--recipient", "globex", *named)[0] == 0
    assert [(e["asset"], e["version"], e["recipient"]) for e in entries()] == [
        ("horns", entry["version"], "Zoë 张伟 🐎"),
        ("horns hero", "v012", "globex"),
    ]
    code, out, _ = run("ledger", "list", "--recipient", "Zoe\u0308 张伟 🐎")
    assert out.count("\n") == 1
    assert "horns" in out
    secret = Path("k").read_text().split()[1]
    assert secret not in Path(LEDGER).read_bytes().decode("latin-1")
    assert run(*MARK, "-o", "dry.usdc", "--dry-run")[0] == 0
    assert len(entries()) == 2


@pytest.mark.slow
def test_a_copy_that_was_made_before_is_recorded(
    run: Callable[..., Any], studio: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert command(monkeypatch, *MARK, "-o", "acme.usdc") == 0
    before = state(studio)
    assert not entries()
    code, _, err = run(*MARK, "-o", "acme.usdc")
    assert code == 0
    assert f"{LEDGER}: entry 1 recorded" in err
    assert state(studio) == before
    [entry] = entries()
    assert entry["manifest"] == json.loads(Path("acme.usdc.meshmark.json").read_text())


@pytest.mark.slow
def test_without_its_entry_no_copy_is_left(
    run: Callable[..., Any], studio: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> Any:
        raise OutputError("database or disk is full", source=LEDGER)

    before = state(studio)
    monkeypatch.setattr(Ledger, "append", full)
    mark = (*MARK, "-o", "acme.usdc", "--recipient", "acme", "--master", "master.usdc")
    failed(run(*mark, "--scheme", "apex"), 3, "disk is full")
    assert state(studio) == before
    monkeypatch.undo()
    monkeypatch.chdir(studio)
    assert run(*mark[:-2])[0] == 0
    # What stood there before comes back: the copy, its manifest, and the master.
    Path("master.usdc").write_bytes(b"something")
    before = state(studio)
    monkeypatch.setattr(Ledger, "append", full)
    failed(run(*mark, "--scheme", "apex", "--set", "relief.slope=0.3"), 3, "disk is full")
    assert state(studio) == before
    assert len(entries()) == 1


@pytest.mark.slow
def test_what_fails_before_is_undone_too(
    run: Callable[..., Any], studio: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> Any:
        raise OutputError("no space left", source="acme.usdc")

    before = state(studio)
    monkeypatch.setattr(marking, "read_back", full)
    failed(run(*MARK, "-o", "acme.usdc"), 3, "no space left")
    assert state(studio) == before
    assert not entries()


@pytest.mark.slow
@pytest.mark.parametrize("late", [False, True])
def test_a_signal_leaves_both_or_neither(
    run: Callable[..., Any], studio: Path, monkeypatch: pytest.MonkeyPatch, late: bool
) -> None:
    before, plain = state(studio), Ledger.append

    def stopped(self: Ledger, content: Any) -> Any:
        done = plain(self, content) if late else None
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(0.3)
        return done or plain(self, content)

    monkeypatch.setattr(Ledger, "append", stopped)
    # The signal is heard when copy and entry are both there: if there is still something to stop.
    assert run(*MARK, "-o", "acme.usdc")[0] in (0, 143)
    assert len(entries()) == 1
    assert "acme.usdc" in state(studio)
    monkeypatch.setattr(Ledger, "append", plain)
    reading = marking.read_back

    def early(*arguments: Any) -> Any:
        os.kill(os.getpid(), signal.SIGTERM)
        return reading(*arguments)

    monkeypatch.setattr(marking, "read_back", early)
    before = state(studio)
    assert run(*MARK, "-o", "globex.usdc", "--recipient", "globex")[0] == 143
    assert state(studio) == before
    assert len(entries()) == 1


def meshmark(*arguments: object, **options: Any) -> tuple[int, str, list[str]]:
    """Run the command in a process of its own."""
    done = subprocess.run(
        [*options.pop("within", ()), sys.executable, "-m", "meshmark", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "MESHMARK_JOBS": "1"},
        **options,
    )
    return done.returncode, done.stdout, done.stderr.splitlines()


@pytest.mark.slow
@pytest.mark.parametrize("room", ["ledger", "output"])
def test_a_full_disk(studio: Path, room: str) -> None:
    """No file may grow beyond a size, as where the disk is full."""
    ledger = Ledger(LEDGER)
    if room == "ledger":
        for n in range(64):
            ledger.append({"kind": "mark", "filling": f"{n:03500}"})
        size = Path(LEDGER).stat().st_size
    else:
        size = 8192
    before, kept = state(studio), entries()

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    mark = (*MARK, "-o", studio / "acme.usdc", "--ledger", studio / LEDGER)
    failed(meshmark(*mark, preexec_fn=limited), 3)
    assert state(studio) == before
    assert entries() == kept


@pytest.mark.slow
def test_a_disk_that_is_really_full(run: Callable[..., Any], studio: Path) -> None:
    """The ledger's disk, then the output's: whatever the room on it, both are there or neither."""
    with mounted(studio / "disk") as disk:
        where = disk / "disk.ledger"
        init(str(where))
        kept = where.stat().st_size
        before = state(studio)
        fill(disk, 0)
        failed(run(*MARK, "-o", "acme.usdc", ledger=str(where)), 3, "full")
        (disk / "filler").unlink()
        assert state(studio) == {**before, "disk/disk.ledger": where.read_bytes()}
        assert (entries(str(where)), where.stat().st_size) == ([], kept)
        assert not list(disk.glob("*-journal"))
        where.unlink()
        outcomes = set()
        for room in range(0, 96 << 10, 12 << 10):
            known = len(entries())
            fill(disk, room)
            code, _, err = run(*MARK, "-o", disk / "acme.usdc", "--recipient", f"{room}")
            outcomes.add(code)
            if code:
                failed((code, "", err), 3)
                assert sorted(path.name for path in disk.iterdir()) == ["filler"]
                assert len(entries()) == known
            else:
                assert entries()[-1]["manifest"]["output_files"] == output_hashes(
                    disk / "acme.usdc"
                )
                break
        assert outcomes == {0, 3}


@pytest.mark.slow
def test_a_ledger_that_cannot_be_written(studio: Path) -> None:
    within: tuple[str, ...] = ()
    if os.geteuid() == 0:
        # Permissions do not keep root from anything, unless it gives that up.
        if shutil.which("setpriv") is None:
            pytest.skip("root cannot give up its rights here")
        within = ("setpriv", "--bounding-set=-dac_override", "--inh-caps=-all", "--")
    Path(LEDGER).chmod(0o444)
    before = state(studio)
    mark = (*MARK, "-o", studio / "acme.usdc", "--ledger", studio / LEDGER)
    failed(meshmark(*mark, within=within), 3, "readonly")
    assert state(studio) == before
    code, out, _ = meshmark("ledger", "list", "--ledger", studio / LEDGER, within=within)
    assert (code, out) == (0, "")
    studio.chmod(0o555)
    failed(meshmark("ledger", "init", "--ledger", studio / "other", within=within), 3)


@pytest.mark.slow
def test_the_server_goes_away_in_the_middle(
    run: Callable[..., Any],
    studio: Path,
    postgresql: Server,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    where = postgresql.create("middle")
    init(where)
    before, plain = state(studio), Ledger.append

    def going(self: Ledger, content: Any) -> Any:
        postgresql.stop()
        return plain(self, content)

    monkeypatch.setattr(Ledger, "append", going)
    try:
        failed(run(*MARK, "-o", "acme.usdc", ledger=where), 3, "refused")
        assert state(studio) == before
        failed(run(*MARK, "-o", "acme.usdc", ledger=where), 3, "refused")
    finally:
        postgresql.start()
    assert not entries(where)
    monkeypatch.setattr(Ledger, "append", plain)
    assert run(*MARK, "-o", "acme.usdc", ledger=where)[0] == 0
    assert len(entries(where)) == 1


@pytest.mark.slow
def test_the_server_goes_away_while_the_entry_is_written(
    run: Callable[..., Any],
    studio: Path,
    postgresql: Server,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    where = postgresql.create("within")
    init(where)
    assert run(*MARK, "-o", "acme.usdc", ledger=where)[0] == 0
    before, plain = state(studio), store.Link.of

    def going(*arguments: Any) -> Any:
        # The lock is held, and the entry about to be inserted.
        postgresql.stop()
        return plain(*arguments)

    monkeypatch.setattr(store.Link, "of", going)
    changed = (*MARK, "-o", "acme.usdc", "--set", "relief.slope=0.3")
    try:
        failed(run(*changed, ledger=where), 3, "postgresql://")
        # The copy that stood there is back, and still the one that the ledger knows.
        assert state(studio) == before
    finally:
        monkeypatch.setattr(store.Link, "of", plain)
        postgresql.start()
    assert len(entries(where)) == 1
    assert run(*changed, ledger=where)[0] == 0
    assert len(entries(where)) == 2


@pytest.mark.slow
def test_a_server_that_may_only_be_read_is_told_of_before_any_work(
    run: Callable[..., Any], postgresql: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    def embedded(*_: Any, **__: Any) -> Any:
        raise AssertionError("work was done")

    where = postgresql.create("standby")
    init(where)
    postgresql.ask("ALTER DATABASE standby SET default_transaction_read_only = on")
    monkeypatch.setattr(marking, "mark_file", embedded)
    failed(run(*MARK, "-o", "acme.usdc", ledger=where), 3, "read-only")
    failed(run("ledger", "init", ledger=postgresql.url("none")), 3, "does not exist")


@pytest.mark.slow
def test_a_clock_that_was_set_back_is_warned_of(
    run: Callable[..., Any], studio: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Early(datetime):
        @classmethod
        def now(cls, tz: Any = None) -> datetime:
            return datetime.now(tz) - timedelta(days=400)

    assert run(*MARK, "-o", "acme.usdc")[0] == 0
    monkeypatch.setattr(store, "datetime", Early)
    code, _, err = run(*MARK, "-o", "globex.usdc", "--recipient", "globex")
    assert code == 0
    [warning] = [line for line in err if "clock" in line]
    assert re.search(r"this clock is 345(59|60)\d{3} s behind", warning)
    assert [entry["recipient"] for entry in entries()] == [None, "globex"]


@pytest.mark.slow
def test_a_ledger_is_asked_for_before_any_work(
    run: Callable[..., Any], studio: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def embedded(*_: Any, **__: Any) -> Any:
        raise AssertionError("work was done")

    monkeypatch.setattr(marking, "mark_file", embedded)
    mark = (*MARK, "-o", "acme.usdc")
    failed(run(*mark, ledger="none"), 3, "none", "meshmark ledger init")
    failed(run(*mark, ledger="postgresql://td:secret@127.0.0.1:1/x"), 3, "refused")
    failed(run(*mark, ledger="mysql://td:secret@db/x"), 2, "--ledger takes")
    failed(run(*mark, "--asset", " "), 2, "the name of an asset")
    failed((command(monkeypatch, *mark, "--asset", "a"), "", ["error: --ledger"]), 2, "--ledger")


@pytest.mark.parametrize("missing", ["sqlalchemy", "alembic", "psycopg", "rfc3161_client"])
def test_a_missing_extra_is_named(
    run: Callable[..., Any], studio: Path, monkeypatch: pytest.MonkeyPatch, missing: str
) -> None:
    from meshmark.ledger import extra

    plain = extra.find_spec
    monkeypatch.setattr(extra, "find_spec", lambda name: None if name == missing else plain(name))
    words = ("needs", missing, "pip install 'meshmark[ledger]'")
    if missing == "psycopg":
        failed(run("ledger", "list", ledger="postgresql://127.0.0.1:1/x"), 2, *words)
    elif missing == "rfc3161_client":
        failed(run("ledger", "verify"), 2, *words)
    else:
        failed(run("ledger", "list"), 2, *words)
        failed(run("ledger", "init"), 2, *words)


def test_folders_and_files_are_put_back(tmp_path: Path) -> None:
    one, two = tmp_path / "one.usdc", tmp_path / "two"
    one.write_bytes(b"one")
    (tmp_path / "one.usdc.0.bin").write_bytes(b"data")
    (tmp_path / "one.usdc.assets" / "1").mkdir(parents=True)
    (tmp_path / "one.usdc.assets" / "1" / "a.png").write_bytes(b"picture")
    before = state(tmp_path)

    def altered() -> None:
        for name in ("one.usdc", "one.usdc.meshmark.json", "one.usdc.1.bin"):
            (tmp_path / "new").write_bytes(b"other")
            (tmp_path / "new").replace(tmp_path / name)
        (tmp_path / "one.usdc.0.bin").unlink()
        shutil.rmtree(tmp_path / "one.usdc.assets")
        (tmp_path / "one.usdc.assets").mkdir()
        two.mkdir()
        (two / "0001.obj").write_bytes(b"v")

    def interrupted(settled: bool) -> None:
        with as_they_were([one, two]) as undoing:
            altered()
            if settled:
                undoing.settle(lambda: None)
            raise OutputError("the end")

    with pytest.raises(OutputError, match="end"):
        interrupted(settled=False)
    assert state(tmp_path) == before
    with pytest.raises(OutputError, match="end"):
        interrupted(settled=True)
    assert one.read_bytes() == b"other"
    assert not list(tmp_path.glob(".meshmark*"))
