"""From a leaked copy to asset, version and recipient, by all keys and names of a ledger."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from command_line import command
from marked_studio import record_for_all, rock, write_rocks
from meshmark import verify
from meshmark.alignment.likeness import signatures
from meshmark.commands import origin_search as searching
from meshmark.commands.attack import write_attacked
from meshmark.commands.batch import Task
from meshmark.commands.identification import Request
from meshmark.commands.identify import identify, identify_file
from meshmark.embedding.file import mark_file
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import make_attack
from meshmark.keys import Key, keys_in
from meshmark.ledger.marks import mark_of
from meshmark.ledger.origins import Origin, origins
from meshmark.ledger.store import Ledger, init
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.sources.reading import read
from meshmark.testing.informed_schemes import horned
from meshmark.testing.meshes import icosphere
from meshmark.testing.schemas import schema_folder
from meshmark_plugins.readers.obj_write import write_new

KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))
RELIEF = [Recipe("relief")]


def test_keys_are_those_of_a_folder(tmp_path: Path) -> None:
    KEY.save(tmp_path / "a.key")
    OTHER.save(tmp_path / "b.key")
    (tmp_path / "README").write_text("keys")
    assert keys_in(tmp_path) == {KEY.id: KEY, OTHER.id: OTHER}


def entry(sequence: int, recipient: str | None, **other: Any) -> dict[str, Any]:
    layer = {"name": "relief", "parameters": {}}
    source = {"path": "../a.usdc", "files": [{"file": "../a.usdc", "sha256": "ab" * 32}]}
    manifest = {
        "source": source,
        "recipient": recipient,
        "key_id": KEY.id,
        "plugins": {
            "segmenter": {"name": "sdf", "parameters": {}},
            "geodesic": {"name": "heat", "parameters": {}},
        },
        "layers": [layer],
        "prims": [{"points": 8, "faces": 6}],
    }
    return {"sequence": sequence} | mark_of(manifest, Path("/shots/for/x.usdc"), **other)


def test_copies_are_gathered_by_what_they_were_made_of() -> None:
    master = {"path": "/m.usdc", "files": []}
    found = origins(
        [
            entry(1, "acme"),
            {"sequence": 2, "kind": "timestamp"},
            entry(3, "Zoë", master=master),
            entry(4, None),
            entry(5, "acme", version="v2"),
            entry(6, "acme"),
        ]
    )
    assert [(one.asset, one.version, one.names) for one in found] == [
        ("a", "ab" * 6, ("acme", "Zoë")),
        ("a", "v2", ("acme",)),
    ]
    first = found[0]
    assert first.source == Path("/shots/for/../a.usdc")
    assert (first.hypotheses, first.meshes, first.master) == (3, ((8, 6),), master)
    assert first.entries_for("acme") == [1, 6]
    assert first.entries_for(None) == [4]


@pytest.fixture(scope="module")
def studio(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A ledger of three copies of a horned ball by one key, and of one by another."""
    folder = tmp_path_factory.mktemp("studio")
    where = str(folder / "studio.ledger")
    write_attacked(as_asset(horned()), folder / "horns.usdc")
    (folder / "keys").mkdir()
    KEY.save(folder / "keys" / "one.key")
    OTHER.save(folder / "keys" / "two.key")
    init(where)
    for name, key, recipient in [
        ("acme", KEY, "acme"),
        ("zoe", KEY, "Zoë 张伟"),
        ("globex", OTHER, "globex"),
    ]:
        output = folder / f"{name}.usdc"
        made = mark_file(folder / "horns.usdc", output, key, recipe=RELIEF, recipient=recipient)
        Ledger(where).append(mark_of(made.document, output))
    return folder, where


def of(studio: tuple[Path, str]) -> list[Origin]:
    return origins(Ledger(studio[1]).entries())


@pytest.mark.slow
def test_what_is_paid_for_is_every_name_beside_every_original(studio: tuple[Path, str]) -> None:
    folder, _ = studio
    suspect = read(folder / "zoe.usdc")
    found = identify(suspect, of(studio), {KEY.id: KEY, OTHER.id: OTHER})
    # The owner and two names by one key, the owner and one by the other; nothing is read alone.
    assert found.hypotheses == 3 + 2
    best = found.best
    assert best is not None
    assert (best.verdict.recipient, best.by_mark) == ("Zoë 张伟", True)
    single = verify(
        suspect,
        KEY,
        recipes=RELIEF,
        recipients=["acme", "Zoë 张伟"],
        original=read(folder / "horns.usdc"),
    )
    assert best.verdict.log10_p == pytest.approx(single.log10_p + np.log10(5 / 3))


@pytest.mark.slow
def test_originals_are_measured_once_for_many_suspects(
    studio: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    searching._signatures_at.cache_clear()
    measured: list[str] = []

    def counted(original: Asset) -> Any:
        measured.append(original.source)
        return signatures(original)

    monkeypatch.setattr(searching, "signatures", counted)
    suspect = as_asset(horned())
    for _ in range(2):
        identify(suspect, of(studio), {KEY.id: KEY, OTHER.id: OTHER}, most=0)
    assert measured == [str(studio[0] / "horns.usdc")]


@pytest.mark.slow
def test_the_command_names_asset_recipient_and_entry(
    studio: tuple[Path, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, where = studio
    monkeypatch.chdir(folder)
    monkeypatch.setenv("MESHMARK_KEYS", "keys")
    words = ("--ledger", where, "--json", "--trusted")
    assert command(monkeypatch, "identify", "zoe.usdc", "globex.usdc", *words) == 0
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    schema = json.loads((schema_folder("json") / "identify.schema.json").read_text())
    jsonschema.validate(document, schema)
    told = [(s["asset"], s["recipient"], s["entries"], s["told_by"]) for s in document["suspects"]]
    assert told == [("horns", "Zoë 张伟", [2], "mark"), ("horns", "globex", [3], "mark")]
    assert document["suspects"][1]["key_id"] == OTHER.id
    assert "zoe.usdc: marked: horns" in captured.err
    assert "copy of Zoë 张伟, by its mark, entry 2, log10 p" in captured.err
    secrets = [(folder / "keys" / name).read_text().split()[1] for name in ("one.key", "two.key")]
    assert not [secret for secret in secrets if secret in captured.out + captured.err]


@pytest.mark.slow
def test_what_is_unmarked_or_unknown_is_not_identified(
    studio: tuple[Path, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, where = studio
    monkeypatch.chdir(folder)
    monkeypatch.setenv("MESHMARK_KEYS", "keys")
    write_attacked(as_asset(rock(1)), folder / "other.usdc")
    assert command(monkeypatch, "identify", "horns.usdc", "--ledger", where) == 1
    assert "not marked: 2 candidates" in capsys.readouterr().err
    assert command(monkeypatch, "identify", "other.usdc", "--ledger", where) == 4
    # A key that is not at hand is told of, and names nobody.
    monkeypatch.setenv("MESHMARK_KEYS", "one")
    Path("one").mkdir()
    OTHER.save(Path("one") / "two.key")
    assert command(monkeypatch, "identify", "acme.usdc", "--ledger", where) == 4
    err = capsys.readouterr().err
    assert f"key {KEY.id} is missing: 2 copies were not looked for" in err


@pytest.mark.slow
def test_originals_that_were_changed_or_moved_are_told_of(
    studio: tuple[Path, str], tmp_path: Path
) -> None:
    folder, _ = studio
    manifest = json.loads((folder / "acme.usdc.meshmark.json").read_text())
    copies = [{"sequence": 1} | mark_of(manifest, tmp_path / "acme.usdc")]
    suspect = read(folder / "acme.usdc")
    found = identify(suspect, origins(copies), {KEY.id: KEY})
    assert found.best is not None
    assert "no such file" in " ".join(each.why for each in found.candidates)
    write_attacked(as_asset(rock(1)), tmp_path / "horns.usdc")
    found = identify(suspect, origins(copies), {KEY.id: KEY})
    assert "not what was marked" in " ".join(each.why for each in found.candidates)
    assert found.verdict == "inconclusive"


@pytest.mark.slow
def test_originals_are_found_where_their_folder_was_moved_to(
    studio: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    folder, where = studio
    monkeypatch.setenv("MESHMARK_KEYS", str(folder / "keys"))
    (tmp_path / "horns.usdc").write_bytes((folder / "horns.usdc").read_bytes())
    aside = folder / "horns.aside"
    (folder / "horns.usdc").rename(aside)
    words = ("identify", folder / "acme.usdc", "--ledger", where, "--trusted")
    try:
        assert command(monkeypatch, *words) == 4
        assert command(monkeypatch, *words, "--map", f"{folder}={tmp_path}") == 0
        assert "copy of acme, by its mark" in capsys.readouterr().err
        monkeypatch.setenv("MESHMARK_PATHS", f"/nowhere=/x; {folder}={tmp_path}")
        assert command(monkeypatch, *words) == 0
        assert command(monkeypatch, *words, "--map", "here") == 2
        assert "OLD=NEW" in capsys.readouterr().err
    finally:
        aside.rename(folder / "horns.usdc")


@pytest.fixture
def run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Identify a folder of suspects, one of which is none, by a ledger without copies."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MESHMARK_KEYS", "keys")
    Path("keys").mkdir()
    KEY.save(Path("keys/one.key"))
    init("l")
    Path("suspects").mkdir()
    write_new(as_asset(MeshAnimation.from_arrays(*icosphere(1))), Path("suspects/walk"))
    Path("suspects/bad.glb").write_text("not at all")

    def call(*arguments: object) -> tuple[int, str, str]:
        code = command(monkeypatch, "identify", *arguments, "--ledger", "l", "--trusted")
        return code, *capsys.readouterr()

    return call


def lines_of(text: str) -> dict[str, dict[str, Any]]:
    """Read lines by source, each once, without what differs from run to run."""
    schema = json.loads((schema_folder("json") / "identify.schema.json").read_text("utf-8"))
    told = [json.loads(line) for line in text.splitlines()]
    for line in told:
        jsonschema.validate(line, {"$defs": schema["$defs"], "$ref": "#/$defs/line"})
        line.pop("elapsed_s", None)
    assert len({line["source"] for line in told}) == len(told)
    return {line["source"]: line for line in told}


def test_many_are_identified_and_resumed(run: Callable[..., tuple[int, str, str]]) -> None:
    code, out, err = run("suspects", "--resume", "answers", "--jsonl")
    lines = lines_of(out)
    assert code == lines["suspects/bad.glb"]["exit_code"] == 3
    assert lines["suspects/walk"]["verdict"] == "inconclusive"
    assert err.splitlines()[-1] == "2 sources: 1 inconclusive, 1 failed"
    assert Path("answers").read_text() == out
    assert run("suspects", "--resume", "answers", "--jsonl")[:2] == (3, "")
    # Another key, and another ledger, may know it.
    OTHER.save(Path("keys/two.key"))
    assert list(lines_of(run("suspects", "--resume", "answers", "--jsonl")[1])) == list(lines)
    Ledger("l").append(mark_of(entry(1, "acme")["manifest"], Path("x.usdc")))
    assert list(lines_of(run("suspects", "--resume", "answers", "--jsonl")[1])) == list(lines)


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("suspects", "--json", "--resume", "a"), 2, "--json is one document"),
        (("suspects", "--timeout", "-1"), 2, "--timeout must be a positive number"),
        (("suspects", "--scheduler", "tcp://here:1", "--jobs", "2"), 2, "no --jobs"),
        (("suspects", "--resume", "keys/one.key"), 3, "line 1 is no answer"),
        (("suspects", "--resume", "none/a"), 3, "cannot be locked"),
        (("suspects/*.usd", "--jsonl"), 3, "suspects/*.usd: matches nothing"),
        (("@none",), 3, "none: cannot be read"),
    ],
)
def test_nonsense_is_told_of_at_once(
    run: Callable[..., tuple[int, str, str]],
    tmp_path: Path,
    words: tuple[str, ...],
    code: int,
    said: str,
) -> None:
    before = sorted(tmp_path.rglob("*"))
    found, out, err = run(*words)
    assert (found, out) == (code, "")
    assert err.startswith("error: ")
    assert said in err
    assert len(err.splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_keys_are_read_where_a_suspect_is_identified(
    run: Callable[..., tuple[int, str, str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    request = Request([], Path("keys"), [KEY.id], trusted=True)
    request.keys()
    packed = Task(identify_file, request, str(tmp_path)).packed()
    assert KEY.secret not in packed
    assert KEY.secret.hex().encode() not in packed
    monkeypatch.setenv("MESHMARK_VERIFY_MEMORY", "1e6")
    monkeypatch.chdir("/")
    assert pickle.loads(packed)("suspects/walk").answer == "inconclusive"
    (tmp_path / "keys/one.key").unlink()
    refused = pickle.loads(packed)("suspects/walk")
    assert (refused.answer, refused.exit_code) == (None, 2)
    assert f"does not hold the key {KEY.id} here" in refused.error


@pytest.mark.slow
def test_processes_identify_alike(
    studio: tuple[Path, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder, where = studio
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MESHMARK_KEYS", str(folder / "keys"))
    Path("bad.usdc").write_text("not at all")
    Path("list").write_text(f"{folder}/zoe.usdc\nbad.usdc\n")
    found = []
    for jobs in ((), ("--jobs", "2")):
        words = ("identify", "@list", "--ledger", where, "--jsonl", *jobs)
        assert command(monkeypatch, *words) == 3
        found.append(lines_of(capsys.readouterr().out))
    assert found[0] == found[1]
    assert found[0][str(folder / "zoe.usdc")]["recipient"] == "Zoë 张伟"


@pytest.mark.parametrize(
    ("keys", "code", "words"),
    [
        (None, 2, "MESHMARK_KEYS must name the folder"),
        ("none", 3, "none: cannot be read"),
        (".", 3, "is not a meshmark key file"),
    ],
)
def test_without_keys_nothing_is_looked_for(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    keys: str | None,
    code: int,
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    init("l")
    (tmp_path / "bad.key").write_text("no key")
    if keys is None:
        monkeypatch.delenv("MESHMARK_KEYS", raising=False)
    else:
        monkeypatch.setenv("MESHMARK_KEYS", keys)
    assert command(monkeypatch, "identify", "x.usdc", "--ledger", "l") == code
    assert words in capsys.readouterr().err


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Origin]]:
    """A hundred assets, each for a hundred recipients, and a copy of one that was really made."""
    folder = tmp_path_factory.mktemp("farm")
    where = str(folder / "farm.ledger")
    sources = write_rocks(range(100), folder)
    init(where)
    leak = folder / "leak.usdc"
    made = mark_file(sources[42], leak, KEY, recipient="recipient 17")
    record_for_all(where, sources, [f"recipient {n}" for n in range(100)], made.document)
    ledger = Ledger(where)
    assert not list(ledger.findings())
    assert ledger.head()[0] == 10_000
    return folder, origins(ledger.entries())


ATTACKS: dict[str, list[tuple[str, dict[str, Any]]]] = {
    "noise": [("noise", {"amplitude": 0.001})],
    "moved and simplified": [
        ("noise", {"amplitude": 0.0005}),
        ("simplification", {"ratio": 0.5}),
        ("similarity", {}),
    ],
    "half of it, moved": [("cropping", {"share": 0.5}), ("similarity", {})],
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ATTACKS)
def test_one_of_ten_thousand_copies_is_named(farm: tuple[Path, list[Origin]], name: str) -> None:
    folder, known = farm
    mesh: MeshAnimation = read(folder / "leak.usdc").meshes[0]
    for attack, parameters in ATTACKS[name]:
        mesh = make_attack(attack, **parameters).apply(mesh, np.random.default_rng(1))
    found = identify(as_asset(mesh), known, {KEY.id: KEY}).as_json()
    # Each of a hundred names and the owner, alone and beside each of a hundred originals.
    assert found["hypotheses"] == 101 + 100 * 101
    assert (found["verdict"], found["told_by"]) == ("marked", "mark")
    assert (found["asset"], found["recipient"]) == ("rock042", "recipient 17")
    assert found["entries"] == [4218]
    assert found["log10_p"] < -12
