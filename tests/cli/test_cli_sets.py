"""A set of many meshes on the command line: one command marks it, one verdict is on all of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

import meshmark
from command_line import command
from meshmark.cli.console import by_text
from meshmark.keys import Key
from meshmark.testing.meshes import icosphere
from meshmark.testing.schemas import schema_folder
from usd_stages import array

CRUMB = "/Room_set/Crumb"
KEY = ("--key", "k")


@pytest.fixture(scope="module")
def source(data_folder) -> Path:
    return data_folder / "usd" / "ballset" / "StandaloneScene" / "top_layer.usda"


@pytest.fixture(scope="module")
def room(tmp_path_factory, source) -> Path:
    """Return a folder with 35 balls and a crumb, and a marked layer over them."""
    folder = tmp_path_factory.mktemp("room")
    Key(bytes(range(32))).save(folder / "k")
    V, F = icosphere(0)
    crumb = f"""over "Room_set"
    {{
        def Mesh "Crumb"
        {{
            int[] faceVertexCounts = {[3] * len(F)}
            int[] faceVertexIndices = {F.ravel().tolist()}
            point3f[] points = {array(V)}
        }}
    }}"""
    (folder / "set.usda").write_text(f"#usda 1.0\n(\n    subLayers = [@{source}@]\n)\n{crumb}\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        # What is too small for a mark is left alone, and that is not all marked.
        keep = ("--primvars", "keep")
        assert command(patch, "embed", "set.usda", "-o", "marked.usda", *KEY, *keep) == 1
    return folder


def verdict(monkeypatch, capsys, room: Path, name: str, *more: str) -> tuple[int, dict[str, Any]]:
    monkeypatch.chdir(room)
    capsys.readouterr()
    code = command(monkeypatch, "verify", name, *KEY, "--json", *more)
    document = json.loads(capsys.readouterr().out)
    schema = json.loads((schema_folder("json") / "verdict.schema.json").read_text())
    jsonschema.validate(document, schema)
    [found] = document["assets"]
    return code, found


def attributes(stage: Usd.Stage) -> dict[Sdf.Path, Usd.Attribute]:
    """List every attribute of a stage as it is composed, those of instances, too."""
    prims = stage.Traverse(Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate))
    return {each.GetPath(): each for prim in prims for each in prim.GetAttributes()}


def test_what_is_said_of_several_is_said_once() -> None:
    said = [(f"/{n}", "too small") for n in range(5)]
    assert by_text(said) == ["/0, /1, /2 and 2 more: too small"]
    assert by_text([("/a", "x"), ("/b", "y"), ("/c", "x")]) == ["/a, /c: x", "/b: y"]


@pytest.mark.slow
def test_all_is_as_it_was_but_the_points_of_the_balls(room) -> None:
    stages = [Usd.Stage.Open(str(room / f"{name}.usda")) for name in ("set", "marked")]
    before, after = map(attributes, stages)
    assert list(before) == list(after)
    changed = {}
    for path, attribute in before.items():
        other = after[path]
        same = attribute.GetTimeSamples() == other.GetTimeSamples() and all(
            attribute.Get(time) == other.Get(time)
            for time in (Usd.TimeCode.Default(), *attribute.GetTimeSamples())
        )
        if not same or attribute.GetAllMetadata().keys() != other.GetAllMetadata().keys():
            changed.setdefault(path.name, set()).add(path.GetPrimPath())
    balls = {Sdf.Path(f"/Room_set/Props/Ball_{n}/mesh") for n in range(1, 36)}
    assert changed.pop("points") == balls
    # What is drawn of a ball follows its points.
    assert set(changed) <= {"extent"}


@pytest.mark.slow
def test_one_verdict_is_on_all_balls(monkeypatch, capsys, room) -> None:
    document = json.loads((room / "marked.usda.meshmark.json").read_text())
    assert len(document["prims"]) == 35
    assert [each["prim"] for each in document["skipped"]] == [CRUMB]
    code, found = verdict(monkeypatch, capsys, room, "marked.usda", "--original", "set.usda")
    assert (code, found["verdict"]) == (0, "marked")
    [pooled] = [each for each in found["pooled"] if each["scheme"] == "relief"]
    assert pooled["meshes"] == 35
    assert pooled["log10_p"] < -30
    code, found = verdict(
        monkeypatch, capsys, room, "set.usda", "--original", "set.usda", "--scheme", "relief"
    )
    assert (code, found["verdict"]) == (1, "not marked")


@pytest.mark.slow
def test_a_leak_of_the_balls_as_one_mesh_has_the_same_verdict(monkeypatch, capsys, room) -> None:
    frames = [mesh[0] for mesh in meshmark.read(str(room / "marked.usda")).meshes]
    begins = np.cumsum([0, *(len(frame.points) for frame in frames)])
    stage = Usd.Stage.CreateNew(str(room / "leak.usda"))
    leak = UsdGeom.Mesh.Define(stage, "/everything")
    leak.CreatePointsAttr(np.concatenate([frame.points for frame in frames]).astype(np.float32))
    leak.CreateFaceVertexCountsAttr(
        np.concatenate([frame.topology.counts for frame in frames]).astype(np.int32)
    )
    faces = [frame.topology.indices + n for frame, n in zip(frames, begins[:-1], strict=True)]
    leak.CreateFaceVertexIndicesAttr(np.concatenate(faces).astype(np.int32))
    stage.Save()
    code, found = verdict(monkeypatch, capsys, room, "leak.usda", "--original", "set.usda")
    assert (code, found["verdict"]) == (0, "marked")
    [pooled] = [each for each in found["pooled"] if each["scheme"] == "relief"]
    assert pooled["meshes"] == 35
    assert pooled["log10_p"] < -30
