"""What a file gives away is found from outside, and nothing is found where nothing is."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from test_usd_traces import BODY, CORNERS, FORMS, LAYER, POINTS, STUDIO, F, T, stage_of, vec3f

from command_line import command
from folders import FAULTS
from meshmark.errors import InputError, OutputError
from meshmark.testing.schemas import schema_folder
from meshmark.usd import delivery
from meshmark.usd.checking import check_stage
from meshmark.usd.points import StagePoints
from meshmark.usd.reading import read_stage
from meshmark.usd.traces import Traces
from usd_stages import CUBE_INDICES, CUBE_POINTS, cube, moved, sampled, write_text

MARKED = POINTS + np.random.default_rng(8).normal(0, 3e-3, POINTS.shape).astype(np.float32)
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str, str]:
        code = command(monkeypatch, "check", *arguments)
        said = capsys.readouterr()
        return code, said.out, said.err

    return call


def marked_stage(path: Path) -> Usd.Stage:
    stage = stage_of(path)
    UsdGeom.Mesh(stage.GetPrimAtPath(BODY)).GetPointsAttr().Set(vec3f(MARKED))
    return stage


@pytest.mark.parametrize("form", FORMS)
def test_an_unmarked_copy_is_found_and_a_marked_one_is_none(tmp_path: Path, form: str) -> None:
    kind, make = FORMS[form]
    for name, points, expected in (("bad", POINTS, 1), ("good", MARKED, 0)):
        stage = marked_stage(tmp_path / f"{name}.usda")
        stage.GetPrimAtPath(BODY).CreateAttribute("primvars:rest", kind).Set(make(points))
        stage.Save()
        found = check_stage(str(tmp_path / f"{name}.usda"))
        if form in ("decimals", "text", "texts", "integers") and expected == 0:
            # Whether decimals were cut off, or a mark is missing, is not to be told from outside.
            continue
        assert [(each.kind, each.where) for each in found] == [
            ("copy", f"{BODY}.primvars:rest")
        ] * expected


def test_unmarked_twins_are_found_and_marked_ones_are_not(tmp_path: Path) -> None:
    stage = marked_stage(tmp_path / "s.usda")
    twin = UsdGeom.Mesh.Define(stage, "/twin")
    twin.CreatePointsAttr(vec3f(POINTS * 2))
    twin.CreateFaceVertexCountsAttr([3] * len(F))
    twin.CreateFaceVertexIndicesAttr(CORNERS.tolist())
    stage.Save()
    source = str(tmp_path / "s.usda")
    assert {each.where for each in check_stage(source)} == {"/twin.points", f"{BODY}.points"}
    assert check_stage(source, [BODY, "/twin"]) == []
    assert {each.where for each in check_stage(source, [BODY])} == {
        "/twin.points",
        f"{BODY}.points",
    }


def test_a_default_beside_samples_is_found(tmp_path: Path) -> None:
    stage = marked_stage(tmp_path / "s.usda")
    UsdGeom.Mesh(stage.GetPrimAtPath(BODY)).GetPointsAttr().Set(vec3f(POINTS), 3)
    stage.Save()
    assert [each.where for each in check_stage(str(tmp_path / "s.usda"))] == [f"{BODY}.points"]


def test_words_paths_and_layers_are_found(run: Run, tmp_path: Path) -> None:
    marked_stage(tmp_path / "geo.usda").Save()
    write_text(tmp_path / "s.usda", STUDIO, LAYER + "subLayers = [@./geo.usda@]")
    code, out, err = run("s.usda", "--json")
    assert (code, err) == (1, "")
    document = json.loads(out)
    schema = json.loads((schema_folder("json") / "check.schema.json").read_text())
    jsonschema.validate(document, schema)
    found = {(each["kind"], each["where"]) for each in document["findings"]}
    assert {
        ("layer", "./geo.usda"),
        ("path", "/studio/secret_show/skin.png"),
        ("path", "C:/studio/secret_show/skin.png"),
        ("metadata", "/: documentation"),
        ("metadata", "/: customLayerData:author"),
        ("metadata", "/World: customData:author"),
        ("metadata", "/World.userProperties:src: a path"),
        ("metadata", "/World.userProperties:author: names a person or machine"),
    } <= {(kind, where) for kind, where in found} | {
        (each["kind"], f"{each['where']}: {each['what']}") for each in document["findings"]
    }
    assert not any("copyright" in each["where"] for each in document["findings"])


def test_a_deliverable_is_clean(run: Run, tmp_path: Path) -> None:
    stage = stage_of(tmp_path / "s.usda", times=(1, 2))
    body = stage.GetPrimAtPath(BODY)
    for form, (kind, make) in FORMS.items():
        if form not in ("decimals", "half"):
            body.CreateAttribute(f"primvars:{form}", kind).Set(make(POINTS))
    stage.Save()
    original = read_stage(str(tmp_path / "s.usda"))
    delivery.write_flattened(original, moved(original), tmp_path / "o.usdc")
    assert run("o.usdc")[:2] == (0, "o.usdc: nothing found\n")


def test_what_would_be_left_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = stage_of(tmp_path / "s.usda")
    stage.GetPrimAtPath(BODY).CreateAttribute("primvars:rest", T.Point3fArray).Set(vec3f(POINTS))
    stage.Save()
    original = read_stage(str(tmp_path / "s.usda"))
    monkeypatch.setattr(delivery, "replace_traces", lambda *_: [])
    with pytest.raises(OutputError, match="primvars:rest"):
        delivery.write_flattened(original, moved(original), tmp_path / "o.usda")
    assert [path.name for path in tmp_path.iterdir()] == ["s.usda"]


def test_what_cannot_be_checked(run: Run, tmp_path: Path) -> None:
    (tmp_path / "bad.usda").write_text("a shopping list")
    (tmp_path / "o.usda").write_text("#usda 1.0\n")
    (tmp_path / "o.usda.meshmark.json").write_text("[]")
    for name in ("none.usda", "bad.usda", "a.obj", "o.usda"):
        code, out, err = run(name)
        assert (code, out, err.count("\n")) == (3, "", 1), name


def test_a_crash_costs_one_line(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    marked_stage(tmp_path / "s.usda").Save()
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    monkeypatch.setenv("TMPDIR", str(scratch))
    for file in (FAULTS / "crate-crash").iterdir():
        code, out, err = run(str(file))
        assert (code, out, err.count("\n")) == (3, "", 1)
        # pxr leaves a report of its crash there.
        assert [path.name for path in scratch.iterdir()] == []
    monkeypatch.setenv("MESHMARK_READ_MEMORY", "0.001")
    code, out, err = run("s.usda")
    assert (code, out, err.count("\n")) == (3, "", 1)
    assert run("s.usda", "--trusted")[0] == 0


def test_absolute_paths_in_text_are_told_from_prims(tmp_path: Path) -> None:
    stage = marked_stage(tmp_path / "s.usda")
    prim = stage.GetPrimAtPath("/World")
    for name, text in {
        "a": "/World/body", "b": "1/2/3", "c": "see http://example.org/terms/of/use",
        "d": "x = a / b / c;", "e": "// a comment",
    }.items():  # fmt: skip
        prim.CreateAttribute(name, Sdf.ValueTypeNames.String).Set(text)
    stage.Save()
    assert check_stage(str(tmp_path / "s.usda")) == []


@pytest.mark.parametrize("later", [CUBE_POINTS[:0], CUBE_POINTS[:3], np.tile(CUBE_POINTS, (2, 1))])
def test_a_mesh_of_other_points_at_another_time_has_no_copies(
    tmp_path: Path, later: np.ndarray
) -> None:
    for frames in ({1: CUBE_POINTS, 2: later}, {1: later, 2: CUBE_POINTS}):
        source = write_text(tmp_path / "a.usda", cube(points=sampled(frames)))
        assert check_stage(source) == []


@pytest.mark.parametrize("index", [-1, -9, 8, 2**31 - 1])
def test_a_face_of_no_vertex_is_none_of_check_s_business(tmp_path: Path, index: int) -> None:
    text = cube(more=f"float[] primvars:copy = {[0.0] * 72}")
    text = text.replace(str(CUBE_INDICES), str([*CUBE_INDICES[:-1], index]))
    source = write_text(tmp_path / "a.usda", text)
    assert check_stage(source) == []


@pytest.mark.parametrize(
    "faces", ["int[] faceVertexIndices = [0, 1, 2]", "token[] faceVertexIndices = []"]
)
def test_corners_that_make_no_faces_are_not_gone_through(tmp_path: Path, faces: str) -> None:
    text = cube("m").replace(f"int[] faceVertexIndices = {CUBE_INDICES}", faces)
    stage = Usd.Stage.Open(write_text(tmp_path / "a.usda", text))
    with pytest.raises(InputError):
        Traces(StagePoints(stage)).add("/m", np.nan, CUBE_POINTS)
    assert check_stage(str(tmp_path / "a.usda")) == []
