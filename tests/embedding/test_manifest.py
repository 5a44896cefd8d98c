"""Whatever ends a run: output and manifest belong together, or say that they do not."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from publishing_run import CHANGES, KEY

from meshmark.detection import evidence_cache
from meshmark.detection.evidence_cache import EvidenceFile, kept_evidence
from meshmark.embedding import file as publishing
from meshmark.embedding.file import mark_file
from meshmark.embedding.manifest import (
    announced,
    manifest_path,
    named_schemes,
    output_hashes,
    remark,
)
from meshmark.errors import InputError, OutputError, UsageError
from meshmark.extension.recipe import Recipe
from meshmark.files.locks import held
from meshmark.keys import Key
from meshmark.testing.meshes import bumpy_sphere
from meshmark.testing.schemas import schema_folder
from small_disk import fill, mounted

RUN = Path(__file__).with_name("publishing_run.py")
RECIPE = Recipe("cho2007")


@pytest.fixture
def source(tmp_path) -> Path:
    """Two OBJ frames, which can become a stage or a folder of the same."""
    folder = tmp_path / "frames"
    folder.mkdir()
    V, F = bumpy_sphere(3, np.eye(3))
    for t in (1, 2):
        lines = [f"v {x} {y} {z}" for x, y, z in (t * V).astype(np.float32).tolist()]
        lines += [f"f {i} {j} {k}" for i, j, k in (F + 1).tolist()]
        (folder / f"{t:04d}.obj").write_text("\n".join(lines) + "\n")
    return folder


def mark(source: Path, output: Path, recipient: str) -> dict:
    return mark_file(source, output, KEY, recipe=RECIPE, recipient=recipient).document


def manifest(output: Path) -> dict:
    """Read the manifest beside an output; it is whole and as its schema says."""
    document = json.loads(manifest_path(output).read_text())
    schema = json.loads((schema_folder("json") / "manifest.schema.json").read_text())
    jsonschema.validate(document, schema)
    return document


def speaks_of(output: Path) -> str | None:
    """Whose copy the output is, as the manifest beside it tells; None if it was not verified."""
    if not manifest_path(output).exists():
        return "nobody" if not output.exists() else "a file without manifest"
    found = manifest(output)
    standing = output_hashes(output)
    if "unfinished" not in found:
        assert found["output_files"] == standing
        assert remark(output) is None
        return found["recipient"]
    if output.exists():
        assert remark(output) is not None
    before = found["unfinished"]
    if before["files"] != standing:
        return None
    return before["manifest"]["recipient"] if standing else "nobody"


@pytest.mark.parametrize("name", ["out.usda", "out.usdc", "out"])
def test_a_manifest_has_the_hashes_of_what_was_written(source, tmp_path, name) -> None:
    document = mark(source, tmp_path / name, "acme")
    assert document == manifest(tmp_path / name)
    assert document["output_files"] == output_hashes(tmp_path / name)
    assert len(document["output_files"]) == (2 if name == "out" else 1)
    assert speaks_of(tmp_path / name) == "acme"
    # Under another name it is the same pair.
    moved = tmp_path / f"moved{Path(name).suffix}"
    (tmp_path / name).rename(moved)
    manifest_path(tmp_path / name).rename(manifest_path(moved))
    assert remark(moved) is None
    assert sorted(p.name for p in tmp_path.iterdir() if p.name.startswith(".")) == []


@pytest.mark.parametrize("name", ["out.usda", "out"])
def test_a_manifest_beside_another_file_is_noticed(source, tmp_path, name) -> None:
    output = tmp_path / name
    mark(source, output, "acme")
    file = sorted(output.iterdir())[0] if output.is_dir() else output
    file.write_bytes(file.read_bytes() + b"\n")
    assert "hashes differ" in remark(output)


def test_manifests_of_older_versions_and_of_nobody_are_let_be(source, tmp_path) -> None:
    output = tmp_path / "out.usda"
    document = mark(source, output, "acme")
    del document["output_files"]
    manifest_path(output).write_text(json.dumps(document))
    assert remark(output) is None
    manifest_path(output).unlink()
    assert remark(output) is None
    assert remark(tmp_path / "nowhere") is None


@pytest.mark.parametrize(
    "text",
    [
        "",
        "null",
        "[" * 100_000,
        '{"unfinished": 1, "output_files": 2}',
        '{"output_files": [1]}',
        '{"output_files": [{"file": 1, "sha256": []}]}',
        '{"unfinished": {}}',
        "\xff",
    ],
)
def test_a_strangers_manifest_is_a_remark_at_most(source, tmp_path, text) -> None:
    output = tmp_path / "out.usda"
    mark(source, output, "acme")
    manifest_path(output).write_bytes(text.encode("latin-1"))
    assert "manifest beside it" in remark(output)
    # Nor does it stop who writes anew.
    mark(source, output, "globex")
    assert speaks_of(output) == "globex"


def test_a_manifest_that_is_no_file_is_not_read(source, tmp_path) -> None:
    output = tmp_path / "out.usda"
    mark(source, output, "acme")
    manifest_path(output).unlink()
    os.mkfifo(manifest_path(output))
    assert "not a file" in remark(output)
    with pytest.raises(InputError, match="not a file"), announced({}, output):
        pass


@pytest.mark.parametrize("old", [True, False], ids=["over an old pair", "into an empty place"])
@pytest.mark.parametrize(
    "step", ["write", "read_back", "verify_written", "describe_marks", "write_json"]
)
def test_a_run_that_fails_leaves_the_old_pair_or_says_so(
    source, tmp_path, monkeypatch, step, old
) -> None:
    output = tmp_path / "out.usda"
    if old:
        mark(source, output, "acme")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}

    def fail(*args, **options):
        raise OutputError("no room")

    if step == "write":
        monkeypatch.setattr(publishing, "writer", lambda *a, **k: fail)
    else:
        monkeypatch.setattr(publishing, step, fail)
    with pytest.raises(OutputError, match="no room"):
        mark(source, output, "globex")
    if step == "write":
        assert {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()} == before
    else:
        assert speaks_of(output) is None
        assert manifest(output)["recipient"] == "globex"
    # Whoever comes next is not kept from anything.
    monkeypatch.undo()
    mark(source, output, "initech")
    assert speaks_of(output) == "initech"


def test_nothing_of_an_old_pair_is_forgotten_when_runs_break_off(source, tmp_path) -> None:
    output = tmp_path / "out.usda"
    old = mark(source, output, "acme")
    known = {name: old[name] for name in old.keys() - {"prims", "verification", "output_files"}}
    # Neither of these runs gets to write anything, nor to clean up.
    runs = [announced({**known, "recipient": recipient}, output) for recipient in ("b", "c")]
    for one in runs:
        one.__enter__()
    assert manifest(output)["recipient"] == "c"
    assert manifest(output)["unfinished"]["manifest"] == old
    assert speaks_of(output) == "acme"


def test_a_source_that_changes_while_it_is_marked_is_not_written(
    source, tmp_path, monkeypatch
) -> None:
    embed = publishing.embed

    def meanwhile(*args, **options):
        marked = embed(*args, **options)
        with (source / "0002.obj").open("a") as file:
            file.write("# edited\n")
        return marked

    monkeypatch.setattr(publishing, "embed", meanwhile)
    with pytest.raises(InputError, match=r"0002\.obj: changed while"):
        mark(source, tmp_path / "out.usda", "acme")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["frames"]


@pytest.mark.parametrize("name", ["out.usda", "out"])
def test_what_was_made_before_is_not_made_again(source, tmp_path, monkeypatch, name) -> None:
    output = tmp_path / name
    document = mark(source, output, "acme")
    with monkeypatch.context() as patch:
        patch.setattr(publishing, "embed", None)
        assert mark(source, output, " acme") == document
    assert manifest(output) == document


def test_what_is_not_the_same_is_made_anew(source, tmp_path, monkeypatch) -> None:
    output = tmp_path / "out.usda"
    mark(source, output, "acme")
    given = {"key": KEY, "recipe": RECIPE, "recipient": "acme"}
    finer = Recipe("cho2007", settings={"cho2007": {"bits": 32}})

    def stop(*args, **options):
        raise OutputError("at work")

    monkeypatch.setattr(publishing, "embed", stop)
    for change in (
        {"recipient": "globex"},
        {"key": Key(bytes(32))},
        {"recipe": finer},
        {"primvars": "keep"},
        {"frames": "1:1"},
        {"stamp": True},
        {"deliver": True},
        {"prims": ["/"]},
        {"master": tmp_path / "master.usda"},
    ):
        with pytest.raises(OutputError, match="at work"):
            mark_file(source, output, **{**given, **change})
    for file in (source / "0002.obj", output, manifest_path(output)):
        before = file.read_text()
        file.write_text(f"{before}\n" if file != manifest_path(output) else "{}")
        with pytest.raises(OutputError, match="at work"):
            mark_file(source, output, **given)
        file.write_text(before)
    # And nothing else was changed.
    assert mark_file(source, output, **given).document == manifest(output)


def test_marks_of_one_key_do_not_pile_up(source, tmp_path) -> None:
    first, second = tmp_path / "first.usda", tmp_path / "second.usda"
    mark(source, first, "acme")
    for recipient in ("acme", "globex"):
        with pytest.raises(UsageError, match=r"first\.usda: is marked by this key"):
            mark(first, second, recipient)
    assert not second.exists()
    # Somebody else's mark may lie upon it, as a vendor's upon the studio's.
    mark_file(first, second, Key(bytes(32)), recipe=RECIPE)
    assert remark(second) is None


def test_of_two_runs_one_is_told_at_once(source, tmp_path, monkeypatch) -> None:
    output = tmp_path / "out.usda"
    with held(output):
        with pytest.raises(OutputError, match="written by another run"):
            mark(source, output, "acme")
        # Another output of the same folder is nobody else's business.
        mark(source, tmp_path / "other.usda", "acme")
    assert not output.exists()
    mark(source, output, "acme")
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_a_lock_is_held_by_one_of_many(tmp_path) -> None:
    inside, most, refused = 0, 0, 0
    guard = threading.Lock()

    def try_often() -> None:
        nonlocal inside, most, refused
        for _ in range(200):
            try:
                with held(tmp_path / "out"):
                    with guard:
                        inside += 1
                        most = max(most, inside)
                    with guard:
                        inside -= 1
            except OutputError:
                refused += 1

    threads = [threading.Thread(target=try_often) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert most == 1
    assert list(tmp_path.iterdir()) == []


def run(source: Path, output: Path, recipient: str, *at: int, **options):
    command = [sys.executable, "-P", str(RUN), str(source), str(output), recipient, *map(str, at)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills by signal")
@pytest.mark.parametrize("name", ["out.usda", "out"])
def test_killed_anywhere_the_pair_says_what_it_is(source, tmp_path, name) -> None:
    """A folder of frames is never written over: there the place is empty at first."""
    seen = set()
    for at in range(1, 60):
        output = tmp_path / f"{at}" / name
        output.parent.mkdir()
        if name != "out":
            mark(source, output, "acme")
        done = run(source, output, "globex", at)
        if done.returncode == 0:
            break
        assert done.returncode == -signal.SIGKILL, done.stderr
        told = speaks_of(output)
        seen.add(told)
        # What stands is what the last word says: the old one, or new and not yet verified.
        assert told in {"acme" if name != "out" else "nobody", None, "globex"}
        if name == "out" and output.exists():
            continue
        mark(source, output, "initech")
        assert speaks_of(output) == "initech"
    else:
        pytest.fail("it never came through")
    assert at > len(CHANGES)
    assert None in seen
    assert speaks_of(output) == "globex"


@pytest.mark.slow
def test_of_runs_that_race_for_one_output_one_wins(source, tmp_path) -> None:
    output = tmp_path / "out.usda"
    command = [sys.executable, "-P", str(RUN), str(source), str(output)]
    names = ["acme", "globex", "initech"]
    runs = [subprocess.Popen([*command, n], stderr=subprocess.PIPE, text=True) for n in names]
    errors = [run.communicate()[1] for run in runs]
    for run, error in zip(runs, errors, strict=True):
        assert run.returncode in {0, 3}
        assert error == "" if run.returncode == 0 else "another run" in error
        assert len(error.splitlines()) <= 1
    winners = {name for name, run in zip(names, runs, strict=True) if run.returncode == 0}
    assert speaks_of(output) in winners
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "frames",
        "out.usda",
        "out.usda.meshmark.json",
    ]


def test_two_that_measure_the_same_evidence_at_once_leave_one(
    source, tmp_path, monkeypatch
) -> None:
    gather = evidence_cache.gather
    other = []

    def meanwhile(*args, **options):
        found = gather(*args, **options)
        with monkeypatch.context() as patch:
            patch.setattr(evidence_cache, "gather", gather)
            other.append(kept_evidence(str(source), EvidenceFile(tmp_path / "e"), recipes=[RECIPE]))
        return found

    monkeypatch.setattr(evidence_cache, "gather", meanwhile)
    mine = kept_evidence(str(source), EvidenceFile(tmp_path / "e"), recipes=[RECIPE])
    again = kept_evidence(str(source), EvidenceFile(tmp_path / "e"), recipes=[RECIPE])
    assert mine.items[0].chips == other[0].items[0].chips == again.items[0].chips
    assert sorted(path.name for path in tmp_path.iterdir()) == ["e", "frames"]


@pytest.fixture
def small_disk(tmp_path):
    with mounted(tmp_path / "disk") as place:
        yield place


def refusal(source: Path, output: Path) -> str | None:
    """Mark for globex, and return why that could not be written."""
    try:
        mark(source, output, "globex")
    except OutputError as error:
        return str(error)
    return None


@pytest.mark.parametrize("name", ["out.usda", "out.usdc", "out"])
@pytest.mark.parametrize("old", [True, False], ids=["over an old pair", "into an empty place"])
def test_a_full_disk_is_one_line_and_tears_nothing(source, small_disk, name, old) -> None:
    if old and name == "out":
        pytest.skip("a folder is never written over")
    output = small_disk / name
    if old:
        mark(source, output, "acme")
    ends = set()
    for free in range(0, 200_000, 12_288):
        fill(small_disk, free)
        if (said := refusal(source, output)) is None:
            break
        assert "\n" not in said
        told = speaks_of(output)
        assert told in {"acme" if old else "nobody", None}
        ends.add(told)
        assert not [p for p in small_disk.iterdir() if p.name.startswith(".")]
        if name == "out" and output.exists():
            for file in output.iterdir():
                file.unlink()
    assert speaks_of(output) == "globex"
    assert ("acme" if old else "nobody") in ends


def test_evidence_on_a_full_disk_is_none(source, small_disk) -> None:
    evidence = small_disk / "e"
    fill(small_disk, 0)
    with pytest.raises(OutputError, match="No space"):
        kept_evidence(str(source), EvidenceFile(evidence), recipes=[RECIPE])
    assert [p.name for p in small_disk.iterdir()] == ["filler"]
    fill(small_disk, 100_000)
    assert kept_evidence(str(source), EvidenceFile(evidence), recipes=[RECIPE]).items


def test_schemes_are_named_by_whatever_lies_beside_a_file(tmp_path) -> None:
    output = tmp_path / "o.usdc"
    assert named_schemes(output) == ()
    for text, names in (
        ('{"layers": [{"name": "a"}, {"name": 7}, 7, {"name": "b"}, {"name": "b"}]}', ["a", "b"]),
        ('{"layers": 7}', []),
        ("[]", []),
        ("nothing", []),
    ):
        manifest_path(output).write_text(text)
        assert list(named_schemes(output)) == names
    manifest_path(output).unlink()
    manifest_path(output).mkdir()
    assert named_schemes(output) == ()
