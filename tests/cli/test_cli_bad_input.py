"""Every kind of bad input: the right exit code, one clear line, and nothing written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from command_line import command
from meshmark.errors import CapacityError
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.attacks import sphere
from meshmark_plugins.readers.obj_write import write_new

HEADER = '#usda 1.0\n(\n    defaultPrim = "A"\n)\n'
QUAD = "int[] faceVertexCounts = [4]\n    int[] faceVertexIndices = [0, 1, 2, 3]\n"
POINTS = "point3f[] points = [(0,0,0), (1,0,0), (1,1,0), (0,1,0)]\n"


def mesh(body: str) -> str:
    return f'{HEADER}def Mesh "A"\n{{\n    {body}}}\n'


STAGES = {
    "text that is not USD": ("this is a shopping list\n", "bad.usda"),
    "a stage with no mesh": (f'{HEADER}def Xform "A"\n{{\n}}\n', "mesh"),
    "a mesh with no points": (mesh(QUAD), "/A"),
    "NaN points": (mesh(QUAD + POINTS.replace("(1,1,0)", "(nan,1,0)")), "/A"),
    "infinite points": (mesh(QUAD + POINTS.replace("(1,1,0)", "(inf,1,0)")), "/A"),
    "indices out of range": (mesh(QUAD.replace("3]", "7]") + POINTS), "/A"),
    "zero faces": (
        mesh("int[] faceVertexCounts = []\n    int[] faceVertexIndices = []\n" + POINTS),
        "/A",
    ),
    "point count changing over time": (
        mesh(
            QUAD + "point3f[] points.timeSamples = {\n"
            "        1: [(0,0,0), (1,0,0), (1,1,0), (0,1,0)],\n"
            "        2: [(0,0,0), (1,0,0), (1,1,0)],\n    }\n"
        ),
        "/A",
    ),
    "a mesh too small": (mesh(QUAD + POINTS), "/A"),
}


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run the command line in an empty folder with a key in it."""
    monkeypatch.chdir(tmp_path)
    Key(bytes(range(32))).save(tmp_path / "k")

    def call(*arguments: object) -> tuple[int, str, str]:
        code = command(monkeypatch, *arguments)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def assert_refused(result: tuple[int, str, str], code: int, *named: str) -> None:
    found, out, err = result
    assert found == code, err
    assert out == ""
    errors = [line for line in err.splitlines() if not line.startswith("warning: ")]
    assert len(errors) == 1, err
    assert errors[0].startswith("error: ")
    for name in named:
        assert name in errors[0]
    assert "Traceback" not in err


@pytest.mark.parametrize("name", STAGES)
@pytest.mark.parametrize("command", ["embed", "inspect", "verify"])
def test_bad_stages(run, tmp_path, name, command) -> None:
    text, named = STAGES[name]
    (tmp_path / "bad.usda").write_text(text)
    before = sorted(tmp_path.iterdir())
    if command == "embed":
        result = run("embed", "bad.usda", "-o", "out.usda", "--key", "k")
        assert_refused(result, 3, "bad.usda", named)
    elif name == "a mesh too small":
        # Nothing is wrong with the file: inspect foresees it, and verify finds too few chips.
        code, _, err = run(command, "bad.usda", *(["--key", "k"] if command == "verify" else []))
        assert code == {"inspect": 1, "verify": 4}[command], err
    elif name == "point count changing over time":
        # One bad frame is named and passed over: the others may be marked.
        if command == "inspect":
            code, out, _ = run("inspect", "bad.usda")
            assert code == 1
            assert "cannot hold a mark: 1 bad frames: /A: frame 2: " in out
        else:
            code, _, err = run("verify", "bad.usda", "--key", "k", "--frames", ":")
            assert code == 4, err
            assert "passed over: /A: frame 2: " in err
    else:
        result = run(command, "bad.usda", *(["--key", "k"] if command == "verify" else []))
        assert_refused((result[0], "", result[2]), 3, "bad.usda", named)
    assert sorted(tmp_path.iterdir()) == before


def test_the_frame_to_blame_is_named(run, tmp_path) -> None:
    (tmp_path / "bad.usda").write_text(STAGES["point count changing over time"][0])
    _, _, err = run("embed", "bad.usda", "-o", "out.usda", "--key", "k")
    assert "frame 2" in err


def test_truncated_crate(run, tmp_path) -> None:
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(tmp_path / "whole.usdc"))
    made = UsdGeom.Mesh.Define(stage, "/A")
    made.GetPointsAttr().Set([(float(i), 0, 0) for i in range(500)])
    stage.Save()
    whole = (tmp_path / "whole.usdc").read_bytes()
    (tmp_path / "cut.usdc").write_bytes(whole[: len(whole) // 2])
    assert_refused(run("embed", "cut.usdc", "-o", "o.usda", "--key", "k"), 3, "cut.usdc")
    assert not (tmp_path / "o.usda").exists()


@pytest.mark.parametrize("source", ["gone.usdc", "gone", "gone/*.obj", "gone.glb"])
def test_missing_source(run, source) -> None:
    assert_refused(run("embed", source, "-o", "o.usda", "--key", "k"), 3, source)
    assert run("verify", source, "--key", "k")[0] == 3
    assert run("inspect", source)[0] == 3


def test_obj_frames_with_another_topology(run, tmp_path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
    (folder / "1.obj").write_text(corners + "f 1 2 3 4\n")
    (folder / "2.obj").write_text(corners + "f 1 2 3\nf 1 3 4\n")
    assert_refused(run("embed", "frames", "-o", "o", "--key", "k"), 3, "frames", "connectivity")
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("content", ["", "not a key", "meshmark-key-1\nabcd\n"])
def test_bad_key_files(run, tmp_path, content) -> None:
    (tmp_path / "bad").write_text(content)
    (tmp_path / "a.usda").write_text(mesh(QUAD + POINTS))
    assert_refused(run("embed", "a.usda", "-o", "o.usda", "--key", "bad"), 3, "bad")
    assert_refused(run("embed", "a.usda", "-o", "o.usda", "--key", "none"), 3, "none")


def test_a_key_others_can_read_is_used_with_a_warning(run, tmp_path) -> None:
    (tmp_path / "k").chmod(0o644)
    (tmp_path / "a.usda").write_text(mesh(QUAD + POINTS))
    _, _, err = run("embed", "a.usda", "-o", "o.usda", "--key", "k")
    assert "warning: k: this key file can be read by others" in err


def test_outputs_that_cannot_be_written(run, tmp_path) -> None:
    (tmp_path / "a.usda").write_text(mesh(QUAD + POINTS))
    embed = ("embed", "a.usda", "--key", "k", "-o")
    assert_refused(run(*embed, "gone/o.usda"), 3, "gone")
    assert_refused(run(*embed, "k/o.usda"), 3, "k")
    assert_refused(run(*embed, "/proc/o.usda"), 3, "/proc")
    assert_refused(run(*embed, "a.usda"), 2, "the source itself")
    assert_refused(run(*embed, "o.fbx"), 2, "o.fbx")
    assert_refused(run("keygen", "k"), 3, "never overwritten")
    assert_refused(run("keygen", "gone/k"), 3, "gone/k")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--scheme", "tsai1999"], "tsai2014"),
        (["--segmenter", "scissors"], "sdf"),
        (["--geodesic", "ruler"], "heat"),
        (["--set", "bits"], "NAME=VALUE"),
        (["--set", "colour=red"], "bins"),
        (["--set", "sdf.rays=few"], "rays"),
        (["--strength", "7"], "strength"),
        (["--frames", "9"], "A:B"),
        (["--frames", "50:60"], "50:60"),
        (["--prim", "/B"], "/A"),
        (["--deliver", "--frames", "1:2"], "--deliver"),
    ],
)
def test_requests_that_make_no_sense(run, tmp_path, arguments, named) -> None:
    moving = POINTS.replace("points = ", "points.timeSamples = { 1: ").replace("\n", " }\n")
    (tmp_path / "a.usda").write_text(mesh(QUAD + moving))
    assert_refused(run("embed", "a.usda", "-o", "o.usda", "--key", "k", *arguments), 2, named)
    assert not (tmp_path / "o.usda").exists()


def test_unknown_commands_and_missing_arguments(run) -> None:
    assert run("mark")[0] == 2
    assert run("embed")[0] == 2
    assert run("verify", "a.usda", "--key", "k", "--fpr", "2")[0] == 2
    assert_refused(run("attack", "tickle", "a.usda", "-o", "o.usda"), 2, "noise")
    assert_refused(run("plugins", "check", "tickle"), 2, "tickle")


def test_a_bug_is_said_to_be_one(run, monkeypatch, tmp_path) -> None:
    from meshmark.sources import reading

    def broken(*_: object, **__: object) -> Asset:
        raise ZeroDivisionError("inside")

    monkeypatch.setattr(reading, "read", broken)
    assert_refused(run("inspect", "a.usda"), 70, "bug", "ZeroDivisionError")


def test_a_featureless_ball_is_foreseen_and_refused(run, tmp_path) -> None:
    from meshmark.commands.attack import write_attacked
    from meshmark.testing.attacks import sphere

    V, F = sphere(24)
    animation = MeshAnimation.from_arrays(V, F, prim="/Ball")
    write_attacked(Asset("ball", (animation,), "memory"), tmp_path / "ball.usdc")
    code, out, _ = run("inspect", "ball.usdc", "--json")
    [prim] = json.loads(out)["prims"]
    assert code == 1
    assert not prim["can_hold"]
    assert "nothing sticks out" in prim["reason"]
    assert_refused(run("embed", "ball.usdc", "-o", "o.usda", "--key", "k"), 3, "/Ball")
    assert not (tmp_path / "o.usda").exists()
    code, _, err = run("attack", "marking-again", "ball.usdc", "-o", "again.usdc")
    assert code == 0
    assert "warning: /Ball: attack marking-again left it as it is: 24 points have room" in err


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("number", "size"), [(1, 1e17), (2, 1e17), (5, 1e17), (8, 1e38)])
@pytest.mark.parametrize("scheme", ["apex", "tsai2014", "cho2007"])
def test_a_few_points_far_off_are_no_bug(run, scheme, number, size) -> None:
    write_spikes(number, size)
    code, _, err = run("inspect", "spikes.obj", "--scheme", scheme)
    assert code in (0, 1), err
    code, _, err = run("verify", "spikes.obj", "--scheme", scheme, "--key", "k")
    assert code in (1, 4), err


def write_spikes(number: int, size: float) -> None:
    """Write a ball with a few points far off, as flipped bits make them.

    The segmenter's equations over such faces have no solution.
    """
    V, F = sphere(162)
    V[np.linspace(3, 150, number).astype(int)] *= size
    write_new(Asset("x", (MeshAnimation.from_arrays(V, F),), "none"), Path("spikes.obj"))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("number", "size"), [(1, 1e17), (2, 1e17), (5, 1e17), (8, 1e38)])
def test_parts_of_a_mesh_with_a_few_points_far_off(run, number, size) -> None:
    write_spikes(number, size)
    code, _, err = run("segment", "spikes.obj", "-o", "parts.usda")
    assert code in (0, 3), err
    assert code == 0 or err.startswith("error: spikes.obj: /: the surface is too degenerate")


def test_only_numerical_breakdowns_are_taken_for_lack_of_capacity() -> None:
    from meshmark.mesh.breakdown import breakdown_means_no_capacity

    for error in (
        RuntimeError("Factor is exactly singular"),
        np.linalg.LinAlgError("SVD did not converge"),
    ):
        with pytest.raises(CapacityError, match=str(error)), breakdown_means_no_capacity():
            raise error
    with pytest.raises(RuntimeError, match="a bug"), breakdown_means_no_capacity():
        raise RuntimeError("a bug")


@pytest.mark.parametrize("name", ["", "  ", "a\x1b[2Jb", "\udcff", "x" * 300, "@acme"])
def test_names_that_are_none(run, name) -> None:
    marked = run("embed", "a.usda", "-o", "b.usda", "--key", "k", "--recipient", name)
    assert_refused(marked, 2, "recipient")
    if not name.startswith("@"):
        assert_refused(run("verify", "a.usda", "--key", "k", "--recipient", name), 2, "recipient")


def test_names_files_that_are_none(run, tmp_path) -> None:
    (tmp_path / "names").write_bytes(b"acme\nglo\0bex\n")
    for name in ("names", "nowhere", "."):
        assert_refused(run("verify", "a.usda", "--key", "k", "--recipient", f"@{name}"), 3, name)


def test_verify_says_what_is_missing_from_the_stage(run, tmp_path) -> None:
    payload = 'def Xform "B" (payload = @./gone.usdc@)\n{\n}\n'
    (tmp_path / "a.usda").write_text(mesh(QUAD + POINTS) + payload + 'def Points "P"\n{\n}\n')
    code, out, err = run("verify", "a.usda", "--key", "k", "--json")
    assert code == 4
    notes = json.loads(out)["assets"][0]["notes"]
    for told in ("gone.usdc@ for payload", "not looked at: 1 Points"):
        assert any(told in note for note in notes)
        assert told in err
    code, _, err = run("verify", "a.usda", "--key", "k", "--frames", ":")
    assert code == 4
    assert "gone.usdc@ for payload" in err
