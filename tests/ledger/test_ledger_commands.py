"""The commands on a ledger: what they print, which exit code."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from command_line import command
from meshmark.errors import UsageError
from meshmark.ledger.store import Ledger, init
from meshmark.recipients import recipient_name
from meshmark.testing.schemas import schema_folder

LEDGER = "studio.ledger"


@pytest.fixture
def run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Run a command on a ledger of three copies."""
    monkeypatch.chdir(tmp_path)
    init(LEDGER)
    for n, recipient in enumerate(["acme", "Zoë", None], start=1):
        mark = {"kind": "mark", "asset": f"asset {n}", "version": "v1", "recipient": recipient}
        Ledger(LEDGER).append({**mark, "key_id": "0" * 16, "output": f"/{n}", "manifest": {}})

    def call(*arguments: object) -> tuple[int, str, str]:
        code = command(monkeypatch, "ledger", *arguments, "--ledger", LEDGER)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def validated(text: str) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(text)
    schema = json.loads((schema_folder("json") / "ledger.schema.json").read_text())
    jsonschema.validate(document, schema)
    return document


def test_entries_are_listed_shown_and_exported(run: Callable[..., Any]) -> None:
    code, out, _ = run("list")
    assert code == 0
    assert [line.split("Z  ")[1].split(", key")[0] for line in out.splitlines()] == [
        "asset 1 v1 for acme",
        "asset 2 v1 for Zoë",
        "asset 3 v1 for nobody by name",
    ]
    [only] = json.loads(run("list", "--recipient", "Zoe\u0308", "--json")[1])["entries"]
    assert (only["sequence"], only["recipient"]) == (2, "Zoë")
    assert "manifest" not in only
    assert json.loads(run("show", 2)[1])["manifest"] == {}
    assert run("show", 4)[0] == 3
    code, out, _ = run("export")
    assert run("export", "-o", "all.jsonl")[0] == 0
    assert Path("all.jsonl").read_text() == out
    previous = 64 * "0"
    for line in out.splitlines():
        text = line.partition('"entry":')[2][:-1]
        found = json.loads(line)
        assert found["previous"] == previous
        previous = hashlib.sha256((previous + text).encode()).hexdigest()
        assert found["hash"] == previous
    assert out.count("\n") == 3


def test_a_damaged_ledger_is_told_of(run: Callable[..., Any]) -> None:
    code, out, err = run("verify", "--json")
    whole = validated(out)
    assert (code, whole["entries"], whole["findings"]) == (0, 3, [])
    assert "whole: 3 entries, the last " + whole["head"] in err
    assert run("verify", "--head", whole["head"])[0] == 0
    with sqlite3.connect(LEDGER) as connection:
        connection.execute("DROP TRIGGER entries_remain")
        connection.execute("DELETE FROM ledger_entries WHERE sequence = 2")
    code, out, err = run("verify", "--json")
    assert code == 1
    assert [(e["sequence"], e["kind"]) for e in validated(out)["findings"]] == [(2, "missing")]
    assert f"{LEDGER}: entry 2 is missing" in err
    assert "whole" not in err
    code, _, err = run("verify", "--head", "f" * 64)
    assert (code, err.count("ledger: entry")) == (1, 2)


def test_what_timestamp_needs_is_asked_for(run: Callable[..., Any]) -> None:
    for words in ([], ["--tsa", "http://x", "--query", "q"], ["--tsa", "http://x"]):
        code, _, err = run("timestamp", *words)
        assert (code, err.count("error: ")) == (2, 1)
    assert run("timestamp", "--query", "head.tsq")[0] == 0
    assert Path("head.tsq").stat().st_size > 40
    code, _, err = run("timestamp", "--reply", "none", "--root", "none")
    assert (code, err.count("error: ")) == (3, 1)


@pytest.mark.slow
@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(name=st.text(st.characters(), max_size=300))
def test_any_text_as_a_name_is_recorded_or_refused_in_one_line(
    run: Callable[..., tuple[int, str, str]], name: str
) -> None:
    code, out, err = run("list", f"--recipient={name}")
    try:
        known = recipient_name(name)
    except UsageError:
        assert code == 2
        [line] = err.splitlines()
        assert line.startswith("error: the name of a recipient")
        return
    assert code == 0
    mark = {"kind": "mark", "asset": "any", "version": "v", "recipient": known}
    done = Ledger(LEDGER).append({**mark, "key_id": "0" * 16, "output": "/o", "manifest": {}})
    assert Ledger(LEDGER).entry(done.link.sequence)["recipient"] == known
    found = json.loads(run("list", "--json", f"--recipient={name}")[1])["entries"]
    assert {each["recipient"] for each in found} == {known}
    # For people, an entry is one line, whatever is in it.
    assert out.count("\n") in (len(found), len(found) - 1)
    assert not list(Ledger(LEDGER).findings())
