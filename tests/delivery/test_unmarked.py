"""Nothing leaves the house unmarked in silence."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from meshmark.cli import main
from meshmark.keys import Key
from meshmark.testing.attacks import sphere
from meshmark.testing.schemas import schema_folder
from meshmark.usd.reading import read_stage
from usd_stages import CUBE_POINTS, array, cube, write_text

Run = Callable[..., tuple[int, str]]


def body(name: str = "body", n: int = 1500) -> str:
    """Text of a mesh that cho2007 can mark."""
    V, F = sphere(n)
    V = V * (1 + 0.3 * (997 * np.abs(V @ [1.0, 0.3, 0.7]) % 1.0))[:, None]
    return f"""
    def Mesh "{name}"
    {{
        int[] faceVertexCounts = {[3] * len(F)}
        int[] faceVertexIndices = {F.ravel().tolist()}
        point3f[] points = {array(V.astype(np.float32))}
    }}
    """


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    """Embed scene.usda of an empty folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MESHMARK_JOBS", "1")
    Key(bytes(range(32))).save(tmp_path / "k")

    def call(*arguments: str) -> tuple[int, str]:
        command = ["meshmark", "embed", "scene.usda", "-o", "o.usda", "--key", "k"]
        scheme = ["--scheme", "cho2007", "--set", "bits=32"]
        monkeypatch.setattr(sys, "argv", [*command, *scheme, *arguments])
        code = 0
        try:
            main()
        except SystemExit as stop:
            code = int(stop.code or 0)
        return code, capsys.readouterr().err

    return call


def skipped(tmp_path: Path) -> list[str]:
    document = json.loads((tmp_path / "o.usda.meshmark.json").read_text())
    schema = json.loads((schema_folder("json") / "manifest.schema.json").read_text())
    jsonschema.validate(document, schema)
    return [each["prim"] for each in document["skipped"]]


SQUARE = "[(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]"
VARYING = f"""
def Mesh "odd"
{{
    int[] faceVertexCounts.timeSamples = {{ 1: [3, 3], 2: [4] }}
    int[] faceVertexIndices.timeSamples = {{ 1: [0, 1, 2, 0, 2, 3], 2: [0, 1, 2, 3] }}
    point3f[] points.timeSamples = {{ 1: {SQUARE}, 2: {SQUARE} }}
}}
"""
LATE_NAN = (
    VARYING.replace("1: [3, 3], ", "")
    .replace("1: [0, 1, 2, 0, 2, 3], ", "")
    .replace(f"2: {SQUARE}", "2: [(nan, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]")
)
STOPS = {
    "guide": (
        cube("odd").replace('"odd"\n    {', '"odd"\n{\nuniform token purpose = "guide"'),
        "guide",
    ),
    "no faces": (f'def Mesh "odd"\n{{\npoint3f[] points = {array(CUBE_POINTS)}\n}}', "no faces"),
    "NaN": (cube("odd", "point3f[] points = [(nan, 0, 0), (1, 0, 0)]"), "not finite"),
    "NaN in a later frame": (LATE_NAN, "not finite"),
    "payload that is missing": ('def "odd" (\npayload = @gone.usda@\n)\n{\n}', "gone.usda"),
    "reference that is missing": ('def "odd" (\nreferences = @./gone.usda@\n)\n{\n}', "gone.usda"),
    "prototype of a pure over": (
        'def PointInstancer "many"\n{\nint[] protoIndices = [0]\n'
        "point3f[] positions = [(0, 0, 0)]\nrel prototypes = [</odd>]\n}\n"
        f'over "odd"\n{{\n{cube("in")}\n}}',
        "instancer",
    ),
}


@pytest.mark.parametrize("what", STOPS)
def test_what_cannot_be_marked_stops_a_delivery(run: Run, tmp_path: Path, what: str) -> None:
    odd, reason = STOPS[what]
    write_text(tmp_path / "scene.usda", body() + odd)
    code, said = run("--deliver")
    assert (code, said.count("\n")) == (3, 1)
    assert "/odd" in said
    assert reason in said
    assert "--allow-unmarked /odd" in said
    assert not list(tmp_path.glob("o.usda*"))
    code, said = run("--deliver", "--allow-unmarked", "/odd")
    assert code == 0, said
    assert "/odd" in said
    assert skipped(tmp_path)[0].startswith("/odd")


@pytest.mark.parametrize("what", ["NaN in a later frame", "NaN", "no faces"])
def test_another_mesh_does_not_stop_an_override(run: Run, tmp_path: Path, what: str) -> None:
    write_text(tmp_path / "scene.usda", body() + STOPS[what][0])
    code, said = run()
    assert code == 1
    assert "/odd: not marked" in said
    assert skipped(tmp_path) == ["/odd"]
    assert [mesh.prim for mesh in read_stage(str(tmp_path / "o.usda"), ["/body"]).meshes] == [
        "/body"
    ]


def test_guides_are_expected_in_an_override(run: Run, tmp_path: Path) -> None:
    write_text(tmp_path / "scene.usda", body() + STOPS["guide"][0])
    assert run()[0] == 0
    assert skipped(tmp_path) == []


def test_a_small_mesh_that_can_hold_no_mark_is_told_of(run: Run, tmp_path: Path) -> None:
    eyes = "".join(
        cube(f"eye{i}", f"point3f[] points = {array(CUBE_POINTS * 0.1)}") for i in range(6)
    )
    write_text(tmp_path / "scene.usda", body() + eyes)
    code, said = run("--deliver")
    assert code == 0, said
    assert skipped(tmp_path) == [f"/eye{i}" for i in range(6)]
    assert "/eye0, /eye1, /eye2 and 3 more: not marked" in said
    code, said = run("--deliver", "--all")
    assert all(f"/eye{i}" in said for i in range(6))
    assert run()[0] == 1


@pytest.mark.parametrize(
    "points",
    [
        pytest.param(CUBE_POINTS * 3, id="large"),
        pytest.param(
            np.random.default_rng(0).random((500, 3)).astype(np.float32) * 0.01,
            id="many points",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_considerable_mesh_that_can_hold_no_mark_stops(
    run: Run, tmp_path: Path, points: np.ndarray
) -> None:
    write_text(tmp_path / "scene.usda", body() + cube("box", f"point3f[] points = {array(points)}"))
    code, said = run("--deliver")
    assert code == 3
    assert "--allow-unmarked /box" in said
    assert not list(tmp_path.glob("o.usda*"))
    assert run("--deliver", "--allow-unmarked", "/box")[0] == 0
    assert run("--deliver", "--allow-unmarked", "all")[0] == 0
    assert run("--deliver", "--allow-unmarked", "/bo")[0] == 3
    assert run("--allow-unmarked", "/box")[0] == 2


def test_meshes_beside_those_asked_for_are_named(run: Run, tmp_path: Path) -> None:
    write_text(tmp_path / "scene.usda", body() + cube("box"))
    code, said = run("--deliver", "--prim", "/body")
    assert code == 0
    assert "/box: not marked: not asked for" in said
    assert skipped(tmp_path) == ["/box"]


def test_a_rigged_mesh_is_said_to_be_one(run: Run, tmp_path: Path) -> None:
    bound = body().replace(
        '"body"\n    {',
        """"body" (
        prepend apiSchemas = ["SkelBindingAPI"]
    )
    {
        rel skel:skeleton = </root/bones>
        int[] primvars:skel:jointIndices = [0] (
            elementSize = 1
            interpolation = "constant"
        )
        float[] primvars:skel:jointWeights = [1] (
            elementSize = 1
            interpolation = "constant"
        )""",
    )
    still = "[((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))]"
    bones = f"""
    def Skeleton "bones"
    {{
        uniform token[] joints = ["hip"]
        uniform matrix4d[] bindTransforms = {still}
        uniform matrix4d[] restTransforms = {still}
    }}
    """
    write_text(tmp_path / "scene.usda", f'def SkelRoot "root"\n{{\n{bound}\n{bones}\n}}')
    code, said = run("--deliver")
    assert code == 0, said
    assert "/root/body: rigged: posed by /root/bones" in said
    document = json.loads((tmp_path / "o.usda.meshmark.json").read_text())
    assert document["prims"][0]["notes"] == ["rigged: posed by /root/bones"]
