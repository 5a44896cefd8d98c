"""`verify --store`, then `try`."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from command_line import command
from meshmark.detection import evidence_cache
from meshmark.keys import Key
from meshmark.testing.meshes import bumpy_sphere
from meshmark.testing.schemas import schema_folder

pytest.importorskip("pyarrow")

VERIFY = ("verify", "ball.obj", "--scheme", "cho2007", "--trusted", "--key", "k", "--store", "s")


@pytest.fixture
def folder(tmp_path, monkeypatch) -> Path:
    monkeypatch.chdir(tmp_path)
    V, F = bumpy_sphere(3, np.eye(3))
    lines = [f"v {x} {y} {z}" for x, y, z in V.astype(np.float32).tolist()]
    lines += [f"f {i} {j} {k}" for i, j, k in (F + 1).tolist()]
    (tmp_path / "ball.obj").write_text("\n".join(lines) + "\n")
    Key(bytes(range(32))).save(tmp_path / "k")
    return tmp_path


def test_what_is_stored_is_not_measured_again(folder, monkeypatch, capsys) -> None:
    gather, measured = evidence_cache.gather, []

    def noted(asset, **options):
        measured.append(options["look"].frames)
        return gather(asset, **options)

    monkeypatch.setattr(evidence_cache, "gather", noted)
    answers = []
    for _ in range(2):
        command(monkeypatch, *VERIFY, "--jsonl")
        answers.append(json.loads(capsys.readouterr().out))
    assert measured == [12]
    first, again = ({**answer, "elapsed_s": 0} for answer in answers)
    assert first == again
    schema = json.loads((schema_folder("json") / "verdict.schema.json").read_text())
    line = {"$ref": "#/$defs/line", "$defs": schema["$defs"]}
    jsonschema.validate(answers[0], line)
    assert [each["file"] for each in first["files"]] == ["ball.obj"]
    assert first["asked"]["stored"] is True
    (folder / "copy.obj").write_bytes((folder / "ball.obj").read_bytes())
    command(monkeypatch, "verify", "copy.obj", *VERIFY[2:])
    assert measured == [12]
    (folder / "copy.obj").write_bytes(b"v 0 0 9\n" + (folder / "ball.obj").read_bytes())
    command(monkeypatch, "verify", "copy.obj", *VERIFY[2:])
    command(monkeypatch, *VERIFY, "--frames", ":")
    assert measured == [12, 12, None]
    assert len(list((folder / "s").iterdir())) == 3
    assert command(monkeypatch, "try", "--store", "s", "--key", "k") in (1, 4)
    assert str(folder / "ball.obj") in capsys.readouterr().err


def test_evidence_is_kept_in_one_place(folder, monkeypatch, capsys) -> None:
    assert command(monkeypatch, *VERIFY, "--evidence", "e") == 2
    assert "--evidence and --store both say where evidence is kept" in capsys.readouterr().err
