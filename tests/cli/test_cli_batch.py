"""Many copies verified by one command: streamed, resumed, in several processes."""

from __future__ import annotations

import json
import os
import pickle
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from command_line import command
from long_sources import slow_to_measure
from meshmark.commands import verify as verifying
from meshmark.commands.attack import write_attacked
from meshmark.commands.batch import Task, answer_many
from meshmark.commands.verification import Request
from meshmark.commands.verify import verify_file
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import icosphere
from meshmark.testing.schemas import schema_folder
from meshmark.workers.apart import Apart
from meshmark_plugins.readers.obj_write import write_new

KEY = Key(bytes(range(32)))
VERIFY = ("verify", "suspects", "--key", "k", "--scheme", "cho2007", "--trusted")
ALL_FRAMES = ("verify", "suspects", "--key", "k", "--scheme", "apex", "--trusted", "--frames", ":")


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run the command line beside a folder of suspects, one of which is none."""
    monkeypatch.chdir(tmp_path)
    KEY.save(tmp_path / "k")
    ball = Asset("ball", (MeshAnimation.from_arrays(*icosphere(1)),), "memory")
    Path("suspects").mkdir()
    write_new(ball, Path("suspects/walk"))
    write_new(ball, Path("suspects/it's a ball"))
    Path("suspects/bad.glb").write_text("not at all")

    def call(*arguments: object) -> tuple[int, str, str]:
        code = command(monkeypatch, *arguments)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def parsed(lines: str) -> dict[str, Any]:
    """Read lines by source, each once, without what differs from run to run."""
    schema = json.loads((schema_folder("json") / "verdict.schema.json").read_text("utf-8"))
    told = [json.loads(line) for line in lines.splitlines()]
    for line in told:
        jsonschema.validate(line, {"$defs": schema["$defs"], "$ref": "#/$defs/line"})
        line.pop("elapsed_s", None)
    assert len({line["source"] for line in told}) == len(told)
    return {line["source"]: line for line in told}


def test_a_line_tells_of_each_source(run) -> None:
    code, out, err = run(*VERIFY, "--jsonl", "--recipient", "acme")
    lines = parsed(out)
    assert list(lines) == ["suspects/bad.glb", "suspects/it's a ball", "suspects/walk"]
    assert code == lines["suspects/bad.glb"]["exit_code"] == 3
    assert lines["suspects/walk"]["verdict"] == "inconclusive"
    assert lines["suspects/walk"]["asked"]["recipients"]["count"] == 1
    assert [each["file"] for each in lines["suspects/walk"]["files"]] == ["walk/0001.obj"]
    assert err.splitlines()[-1] == "3 sources: 2 inconclusive, 1 failed"
    assert KEY.secret.hex() not in out + err
    # One document has verdicts only.
    document = json.loads(run(*VERIFY, "--json")[1])
    assert [each["source"] for each in document["assets"]] == list(lines)[1:]


def test_a_run_is_resumed(run, tmp_path) -> None:
    assert run(*VERIFY, "--resume", "answers")[0] == 3
    whole = Path("answers").read_text()
    code, out, err = run(*VERIFY, "--resume", "answers", "--jsonl")
    assert (code, out) == (3, "")
    assert err.splitlines() == ["3 sources: 2 inconclusive, 1 failed, 3 of them before"]
    assert Path("answers").read_text() == whole
    lines = whole.splitlines(keepends=True)
    Path("answers").write_text(lines[0] + lines[1][:100])
    code, out, _ = run(*VERIFY, "--resume", "answers", "--jsonl")
    assert list(parsed(out)) == ["suspects/it's a ball", "suspects/walk"]
    assert parsed(Path("answers").read_text()) == parsed(whole)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["answers", "k", "suspects"]


def test_a_bug_stops_no_other_file(run, monkeypatch) -> None:
    def read(source: str, **options: object) -> Asset:
        if "ball" in source:
            raise ZeroDivisionError("one by\nnought")
        return real(source, **options)

    real = verifying.read
    monkeypatch.setattr(verifying, "read", read)
    code, out, err = run(*VERIFY, "--jsonl")
    assert code == parsed(out)["suspects/it's a ball"]["exit_code"] == 70
    assert "bug in meshmark: ZeroDivisionError: one by nought; MESHMARK_DEBUG=1" in err
    assert parsed(out)["suspects/walk"]["verdict"] == "inconclusive"


@pytest.mark.slow
def test_commands_do_the_same_elsewhere(run, tmp_path, monkeypatch) -> None:
    expected = parsed(run(*VERIFY, "--jsonl", "--recipient", "@@a b", "--fpr", "1e-4")[1])
    told = ("--resume", "a.jsonl", "--recipient", "@@a b", "--fpr", "1e-4")
    code, out, err = run(*VERIFY, *told, "--commands", "farm.sh", "--chunk", "2")
    assert (code, out, err) == (0, "", "farm.sh: 2 commands for 3 sources\n")
    lines = Path("farm.sh").read_text().splitlines()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    for line in lines:
        program, *words = shlex.split(line)
        assert program == "meshmark"
        run(*words)
    found = parsed("".join((tmp_path / f"a.000{i}.jsonl").read_text() for i in (1, 2)))
    assert {os.path.relpath(name, tmp_path) for name in found} == set(expected)
    assert {each["asked"]["fpr"] for each in found.values()} == {1e-4}
    assert KEY.secret.hex() not in "".join(lines)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("suspects", "--json", "--jsonl"), 2, "--json is one document"),
        (("suspects", "--evidence", "e"), 2, "--evidence holds that of one SOURCE"),
        (("suspects/walk", "--evidence", "e", "--jsonl"), 2, "--evidence holds that of one SOURCE"),
        (("suspects", "--resume", "k"), 3, "k: line 1 is no answer"),
        (("suspects", "--resume", "none/answers"), 3, "none/answers: cannot be locked"),
        (("suspects", "--commands", "none/farm"), 3, "none/farm: cannot be written"),
        (("suspects", "--timeout", "0"), 2, "--timeout must be a positive number"),
        (("suspects", "--timeout", "nan"), 2, "--timeout must be a positive number"),
        (("suspects", "--commands", "f", "--json"), 2, "--commands verifies nothing by itself"),
        (("suspects", "--jsonl", "--original", "none.usd"), 3, "none.usd: no such file"),
        (("@none",), 3, "none: cannot be read"),
        (("suspects/*.usd",), 3, "suspects/*.usd: matches nothing"),
    ],
)
def test_nonsense_is_told_of_at_once(run, tmp_path, words, code, said) -> None:
    before = sorted(tmp_path.iterdir())
    found, out, err = run("verify", *words, "--key", "k", "--trusted")
    assert (found, out) == (code, "")
    assert err.startswith("error: ")
    assert said in err
    assert len(err.splitlines()) == 1
    assert sorted(tmp_path.iterdir()) == before


def test_the_key_stays_where_it_is(run, monkeypatch) -> None:
    request = Request(Path("k"), KEY.id, [Recipe("cho2007")], named=True, trusted=True)
    task = Task(verify_file, request, str(Path.cwd()))
    assert KEY.secret not in task.packed()
    assert KEY.secret.hex().encode() not in task.packed()
    monkeypatch.chdir("/")
    monkeypatch.setenv("MESHMARK_VERIFY_MEMORY", "1e6")
    again = pickle.loads(task.packed())
    assert again("suspects/walk").answer == "inconclusive"
    # A folder that is not there, and another key in the file.
    assert Task(verify_file, request, "/none")("suspects/walk").exit_code == 3
    Path("k").unlink()
    Key(bytes(32)).save(Path("k"))
    refused = again("suspects/walk")
    assert (refused.answer, refused.exit_code) == (None, 2)
    assert f"holds the key {Key(bytes(32)).id} here, not {KEY.id}" in refused.error


@pytest.mark.slow
def test_processes_answer_alike_and_outlive_one_that_dies(run, monkeypatch) -> None:
    alone = parsed(run(*VERIFY, "--jsonl")[1])
    code, out, _ = run(*VERIFY, "--jsonl", "--jobs", "2")
    assert code == 3
    assert parsed(out) == alone
    # Whatever dies at first is tried again.
    real, died = Apart.__call__, list[str]()

    def dying(self: Apart, item: str) -> Any:
        if item not in died:
            died.append(item)
            self._started().kill()
        return real(self, item)

    monkeypatch.setattr(Apart, "__call__", dying)
    code, out, _ = run(*VERIFY, "--jsonl", "--jobs", "2")
    assert len(died) == 3
    assert (code, parsed(out)) == (3, alone)


@pytest.mark.slow
def test_what_dies_every_time_is_an_outcome(run, monkeypatch) -> None:
    # Too little to import what measures.
    monkeypatch.setenv("MESHMARK_VERIFY_MEMORY", "0.05")
    request = Request(Path("k"), KEY.id, [Recipe("cho2007")], named=True, trusted=True)
    task = Task(verify_file, request, str(Path.cwd()))
    outcomes = list(answer_many(["suspects/walk", "suspects/it's a ball"], task, 2))
    assert {outcome.source for outcome in outcomes} == {"suspects/walk", "suspects/it's a ball"}
    assert {outcome.exit_code for outcome in outcomes} <= {3, 5}


@pytest.mark.slow
def test_what_takes_too_long_stops_no_other(run, monkeypatch) -> None:
    write_attacked(slow_to_measure(), Path("suspects/long.usdc"))
    words = ("--jobs", "2", "--timeout", "15", "--resume", "answers", "--jsonl")
    code, out, err = run(*ALL_FRAMES, *words)
    lines = parsed(out)
    assert code == 3
    late = lines.pop("suspects/long.usdc")
    assert (late["exit_code"], late["timeout"]) == (3, 15)
    assert late["error"] == "suspects/long.usdc: takes longer than 15 s; --timeout can allow more"
    assert f"error: {late['error']}\n" in err
    assert [each["file"] for each in late["files"]] == ["long.usdc"]
    assert {line.get("verdict") for line in lines.values()} == {"inconclusive", None}
    # It is not tried again, unless it may take longer.
    code, out, err = run(*ALL_FRAMES, *words)
    assert (code, out) == (3, "")
    assert "4 of them before" in err


@pytest.mark.slow
def test_a_killed_run_is_resumed(run, tmp_path) -> None:
    for i in range(12):
        ball = Asset("ball", (MeshAnimation.from_arrays(*icosphere(1)),), "memory")
        write_new(ball, Path(f"suspects/more_{i}"))
    words = [sys.executable, "-m", "meshmark", *VERIFY, "--resume", "answers", "--jobs", "2"]
    process = subprocess.Popen(words, stderr=subprocess.DEVNULL)
    answers = Path("answers")
    while not answers.exists() or answers.read_text().count("\n") < 4:
        time.sleep(0.05)
        assert process.poll() is None
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = answers.read_text().count("\n")
    assert before < 15
    assert run(*VERIFY, "--resume", "answers")[0] == 3
    assert len(parsed(answers.read_text())) == 15
    assert sorted(path.name for path in tmp_path.iterdir()) == ["answers", "k", "suspects"]
