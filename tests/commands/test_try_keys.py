"""Many keys on the evidence of many sources."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from command_line import command
from detection.stored_sources import beside_the_original, key, mesh, source
from meshmark.commands.try_keys import FEW_KEYS, KeyFiles, try_keys
from meshmark.detection import evidence_store
from meshmark.detection.evidence_store import EvidenceStore, asset_evidence
from meshmark.detection.verify import judge_all
from meshmark.testing.schemas import schema_folder

pytest.importorskip("pyarrow")

KEYS = [key(n) for n in range(20)]


@pytest.fixture
def store(tmp_path) -> EvidenceStore:
    store = EvidenceStore(tmp_path / "store")
    for n in range(4):
        store.add(source(f"clean{n}.usd", [mesh(n)]))
    store.add(source("leak.usd", [mesh(11, KEYS[3], "acme")]))
    store.add(source("other.usd", [mesh(12, KEYS[17])]))
    store.add(source("beside.usd", [mesh(13), beside_the_original(14, KEYS[5], "bob")]))
    return store


@pytest.mark.parametrize("keys", [KEYS, KEYS[1:FEW_KEYS]])
def test_every_mark_is_found_and_paid_for_and_nothing_else(store, keys) -> None:
    names = ["acme", "bob"]
    trials, refusals = try_keys(store, keys, recipients=names)
    assert not refusals
    assert len(trials) == 7
    wanted = {"leak.usd": (KEYS[3], "acme"), "other.usd": (KEYS[17], None)}
    wanted["beside.usd"] = (KEYS[5], "bob")
    wanted = {name: who for name, who in wanted.items() if who[0] in keys}
    found = [trial for trial in trials if trial.matches]
    assert trials[: len(found)] == found
    assert {Path(trial.source).name for trial in found} == set(wanted)
    for trial in found:
        [match] = trial.matches
        own, name = wanted[Path(trial.source).name]
        assert (match.key_id, match.verdict.recipient) == (own.id, name)
        stored = store.find(stored_as(trial))
        alone = judge_all(asset_evidence(stored), own, recipients=names)
        paid = alone.log10_p + np.log10(len(keys))
        assert trial.log10_p == match.verdict.log10_p == pytest.approx(paid)
        assert trial.verdict == "marked"
    ranked = [trial.log10_p for trial in found]
    assert ranked == sorted(ranked)
    assert {trial.verdict for trial in trials[len(found) :]} == {"not marked"}


def stored_as(trial):
    name = Path(trial.source).name
    beside = [beside_the_original(0)] if name == "beside.usd" else []
    return source(name, [mesh(0), *beside])


def test_runs_of_keys_are_joined(store, monkeypatch) -> None:
    whole, _ = try_keys(store, KEYS)
    monkeypatch.setattr("meshmark.commands.try_keys.PAIRS_AT_ONCE", 6)
    monkeypatch.setattr("meshmark.commands.try_keys.FEW_FILES", 3)
    monkeypatch.setattr("meshmark.commands.try_keys.FILES_AT_ONCE", 2)
    told = []
    runs, _ = try_keys(store, KEYS, progress=lambda *counts: told.append(counts))
    assert [trial.as_json() for trial in runs] == [trial.as_json() for trial in whole]
    assert told[-1] == (16, 16)


def test_two_keys_in_one_source_are_both_told(store) -> None:
    items = [mesh(21, KEYS[1]), beside_the_original(22, KEYS[2])]
    store.add(source("two.usd", items))
    [best, *_], _ = try_keys(store, KEYS)
    assert Path(best.source).name == "two.usd"
    assert {match.key_id for match in best.matches} == {KEYS[1].id, KEYS[2].id}
    p = [match.verdict.log10_p for match in best.matches]
    assert p == sorted(p)


@pytest.fixture
def folder(store, tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "keys").mkdir()
    for n, each in enumerate(KEYS[:6]):
        each.save(tmp_path / "keys" / f"{n}.key")
    KEYS[3].save(tmp_path / "the same")
    return tmp_path


def asked(patch, capsys, *arguments) -> tuple[int, dict, str]:
    code = command(patch, "try", "--store", "store", *arguments, "--json")
    out, err = capsys.readouterr()
    document = json.loads(out) if out else {}
    if document:
        schema = json.loads((schema_folder("json") / "try.schema.json").read_text())
        jsonschema.validate(document, schema)
    return code, document, err


def test_the_command_tries_folders_of_keys_and_files(folder, monkeypatch, capsys) -> None:
    (folder / "names").write_text("acme\n")
    code, told, err = asked(
        monkeypatch, capsys, "--key", "keys", "--key", "the same", "--recipient", "@names"
    )
    assert code == 1
    assert (told["keys"], told["names"], told["refused"]) == (6, 2, 0)
    best = told["sources"][0]
    assert best["source"] == "/shots/leak.usd"
    assert best["matches"][0]["recipients"] == [{"recipient": "acme", "log10_p": best["log10_p"]}]
    assert f"/shots/leak.usd: marked, log10 p {best['log10_p']:.2f}; by key {KEYS[3].id}" in err


def test_what_is_forged_is_refused_or_decides_nothing(folder, monkeypatch, capsys) -> None:
    monkeypatch.setenv("MESHMARK_EVIDENCE_SECRET", str(folder / "another"))
    # It claims to be evidence of what is there already.
    forged = EvidenceStore(folder / "forged")
    forged.add(source("clean0.usd", [mesh(1, KEYS[2])]))
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    [path] = forged.paths()
    path.rename(folder / "store" / "0.parquet")
    (folder / "store" / "1.parquet").write_bytes(b"PAR1")
    code, told, err = asked(monkeypatch, capsys, "--key", "keys")
    assert (code, told["refused"], len(told["sources"])) == (3, 2, 7)
    assert "0.parquet: row 1: is not authentic" in err
    assert "1.parquet: is not a file of a store of evidence" in err
    code, told, err = asked(monkeypatch, capsys, "--key", "keys", "--unauthenticated-evidence")
    assert code == 3
    strange = [each for each in told["sources"] if not each["authenticated"]]
    assert [each["verdict"] for each in strange] == ["inconclusive"]
    assert strange[0]["matches"][0]["key_id"] == KEYS[2].id
    assert sum(each["source"] == "/shots/clean0.usd" for each in told["sources"]) == 2


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        (["--key", "nowhere"], 3, "nowhere: cannot be read"),
        (["--key", "store"], 3, "store: holds no key file (*.key)"),
        (["--key", "keys", "--fpr", "0"], 2, "--fpr must lie between 0 and 1"),
        (["--key", "keys", "--store", "nowhere"], 3, "nowhere: cannot be read"),
        (["--key", "keys", "--store", "keys"], 4, "keys: nothing is kept there"),
    ],
)
def test_bad_requests_end_in_one_line(folder, monkeypatch, capsys, arguments, code, told) -> None:
    assert command(monkeypatch, "try", "--store", "store", *arguments) == code
    err = capsys.readouterr().err
    assert told in err
    assert "Traceback" not in err


@pytest.mark.parametrize("name", ["try", "verify"])
def test_what_to_install_is_told(folder, monkeypatch, capsys, name) -> None:
    monkeypatch.setattr(evidence_store, "find_spec", lambda module: None)
    sources = ["a.usd"] if name == "verify" else []
    assert command(monkeypatch, name, *sources, "--key", "the same", "--store", "store") == 2
    assert "pip install 'meshmark[arrow]'" in capsys.readouterr().err


def test_key_files_are_read_when_asked_for(folder) -> None:
    files = sorted((folder / "keys").iterdir())
    keys = KeyFiles(files)
    assert [*keys] == KEYS[:6]
    assert [each.secret for each in keys[2:4]] == [each.secret for each in KEYS[2:4]]
