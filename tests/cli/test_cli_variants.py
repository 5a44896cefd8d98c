"""`--variant` on the command line: what is marked, told and found again, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from command_line import command
from composed_stages import ARCS, Shape
from folders import REPOSITORY
from gltf_files import ball
from meshmark.keys import Key
from meshmark.testing.informed_schemes import horned

SCHEMA = json.loads((REPOSITORY / "schemas" / "json" / "manifest.schema.json").read_text())
MARK = ("--key", "k", "--scheme", "relief", "--trusted")
HIGH = ("--variant", "lod=high")


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(tmp_path)
    Key(bytes(range(32))).save(Path("k"))
    shape = Shape.of(horned()[0].faces, tuple(frame.points for frame in horned()))
    ARCS["variants_of_shape"](tmp_path, shape)

    def call(*arguments: object) -> tuple[int, str, str]:
        code = command(monkeypatch, *arguments)
        told = capsys.readouterr()
        return code, told.out, told.err

    return call


@pytest.mark.slow
def test_a_variant_is_marked_and_found(run):
    code, out, told = run("embed", "scene.usda", "-o", "o.usdc", *MARK, *HIGH, "--json")
    document = json.loads(out)
    assert code == 0
    jsonschema.validate(document, SCHEMA)
    assert document["source"]["variants"] == ["/M{lod=high}"]
    assert document["variants"] == [
        {
            "prim": "/M/m",
            "marked_in": ["/M{lod=high}"],
            "as_they_are": ["/M{lod=low}", "/M{lod=none}"],
        }
    ]
    assert "/M/m: marked in /M{lod=high} only, not in /M{lod=low}, /M{lod=none}" in told
    original = ("--original", "scene.usda")
    # The layer selects the variant itself; the source does not.
    for arguments in ((), HIGH):
        assert run("verify", "o.usdc", *MARK, *original, *arguments)[0] == 0
    assert run("verify", "scene.usda", *MARK, *original, *HIGH)[0] == 1
    assert run("verify", "o.usdc", *MARK, *original, "--variant", "lod=low")[0] == 1
    # A copy beside an original may have lost its variants.
    assert run("embed", "scene.usda", "-o", "all.usdc", *MARK, *HIGH, "--deliver")[0] == 0
    assert run("verify", "all.usdc", *MARK, *original, *HIGH)[0] == 0
    assert run("align", "all.usdc", *original, *HIGH, "--trusted")[0] == 0
    assert run("verify", "all.usdc", *MARK, *HIGH)[0] == 2


def test_other_commands_read_it(run):
    for command_line in (
        ("inspect", "scene.usda", "--scheme", "relief"),
        ("attack", "noise", "scene.usda", "-o", "noisy.usda"),
        ("segment", "scene.usda", "-o", "parts.usda", "--frames", "1:1"),
    ):
        code, _, told = run(*command_line, "--trusted", "--variant", "lod=none")
        assert code == 3
        assert "the stage holds no mesh" in told
        assert told.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (
            ("inspect", "scene.usda", "--trusted", "--variant", "lod=hi"),
            "no variant lod=hi; there is /M{lod=",
        ),
        (
            ("inspect", "scene.usda", "--trusted", "--variant", "lod"),
            "a variant is SET=NAME or PRIM{SET=NAME}",
        ),
        (("inspect", "ball.gltf", "--trusted", *HIGH), "ball.gltf: its reader takes no variants"),
        (("inspect", "ball.obj", "--trusted", *HIGH), "ball.obj: its reader takes no variants"),
        (("embed", "ball.gltf", "-o", "o.usdc", *MARK, *HIGH), "its reader takes no variants"),
        (("verify", "ball.gltf", *MARK, *HIGH), "--variant is for USD files"),
    ],
)
def test_what_cannot_be_done_is_one_line(run, arguments, wanted):
    ball().save(Path("ball.gltf"))
    Path("ball.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    code, out, told = run(*arguments)
    assert (code, out) == (2, "")
    assert wanted in told
    assert told.count("\n") == 1
