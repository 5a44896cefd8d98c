"""Commands on a glTF file: what a user marks, attacks and verifies, and what is refused."""

from __future__ import annotations

import json

import jsonschema
import numpy as np
import pytest

from command_line import command
from gltf_files import ball, draco_quad
from meshmark.embedding.manifest import remark
from meshmark.keys import Key
from meshmark.metrics import distortion
from meshmark.sources.reading import read
from meshmark.testing.schemas import schema_folder
from usd_stages import cube, write_text

SCHEMA = json.loads((schema_folder("json") / "manifest.schema.json").read_text("utf-8"))
TURN = [[0, 0, 0, 1], [0, np.sin(0.5), 0, np.cos(0.5)]]


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Run the command line in a folder with a key and a ball of two clips in it."""
    monkeypatch.chdir(tmp_path)
    Key(bytes(range(32))).save(tmp_path / "k")
    made = ball(3)
    made.json["animations"][0]["name"] = "Bend"
    made.json["animations"].append({"channels": [], "samplers": [], "name": "Turn"})
    made.animate(0, "rotation", [0, 0.25], TURN)
    made.save(tmp_path / "ball.glb")

    def call(*arguments: object) -> tuple[int, str, str]:
        code = command(monkeypatch, *arguments)
        told = capsys.readouterr()
        return code, told.out, told.err

    return call


MARK = ["--key", "k", "--scheme", "relief"]


@pytest.mark.slow
def test_a_clip_is_marked_and_found_beside_the_original(run, tmp_path):
    chosen = ["--clip", "Turn", "--fps", 8]
    code, out, _ = run("embed", "ball.glb", "-o", "out.usdc", *MARK, *chosen, "--json")
    document = json.loads(out)
    assert code == 0
    jsonschema.validate(document, SCHEMA)
    assert document["source"]["parameters"] == {"clip": "Turn", "fps": 8.0}
    [marked] = read("out.usdc").meshes
    np.testing.assert_array_equal(marked.times, [0, 1, 2])
    assert marked.prim == "/root/ball"
    [plain] = read("ball.glb", parameters={"clip": "Turn", "fps": 8.0}).meshes
    for one, two in zip(marked, plain, strict=True):
        assert 0 < np.abs(one.points - two.points).max() < 0.05
    beside = ["--original", "ball.glb", *chosen]
    code, _, told = run("verify", "out.usdc", *MARK, *beside)
    assert code == 0
    assert "out.usdc: marked" in told
    Key(bytes(32)).save(tmp_path / "other")
    code, _, told = run("verify", "out.usdc", *beside, "--key", "other", "--scheme", "relief")
    assert code == 1
    assert "out.usdc: not marked" in told
    assert "nan" not in told
    # The source itself holds no mark.
    code, _, told = run("verify", "ball.glb", *MARK, *beside)
    assert code == 1
    assert "ball.glb: not marked" in told


@pytest.mark.slow
def test_a_copy_is_placed_on_a_clip_of_the_original(run):
    """The copy has one clip, of another name: that is read."""
    assert run(*ATTACK, "copy.glb")[0] == 0
    chosen = ("--original", "ball.glb", "--clip", "Turn", "--fps", 8, "--trusted")
    code, out, _ = run("align", "copy.glb", *chosen, "--json")
    assert code == 0
    [mesh] = json.loads(out)["meshes"]
    assert [frame["time"] for frame in mesh["frames"]] == [0, 1, 2]
    assert {frame["original_time"] for frame in mesh["frames"]} <= {0, 1, 2}


@pytest.mark.slow
def test_a_copy_in_the_format_of_the_source_holds_the_mark(run):
    code, out, _ = run("embed", "ball.glb", "-o", "out.glb", *MARK, "--clip", "Turn", "--json")
    document = json.loads(out)
    assert code == 0
    # Of what was written, beside the original, of that clip.
    assert document["verification"]["verdict"] == "marked"
    parameters = {"clip": "Turn"}
    [marked], [plain] = (
        read(name, parameters=parameters).meshes for name in ("out.glb", "ball.glb")
    )
    apart = [np.abs(one.points - two.points) for one, two in zip(marked, plain, strict=True)]
    assert all(0 < each.max() < 0.05 for each in apart)
    told = document["prims"][0]["distortion"]
    found = distortion(plain, marked, uv=None, jobs=1)
    assert told["mrms"] == pytest.approx(found.mrms, rel=1e-6)
    [other] = read("out.glb").meshes
    assert len(other) == 17
    assert np.abs(other[0].points - read("ball.glb").meshes[0][0].points).max() > 0


@pytest.mark.slow
def test_what_is_beside_a_copy_belongs_to_its_manifest(run, tmp_path):
    code, out, _ = run("embed", "ball.glb", "-o", "out.gltf", *MARK, "--uncompress", "--json")
    document = json.loads(out)
    assert code == 0
    jsonschema.validate(document, SCHEMA)
    assert document["source"]["parameters"] == {"uncompress": True}
    assert [each["file"] for each in document["output_files"]] == ["out.gltf", "out.gltf.0.bin"]
    assert remark(tmp_path / "out.gltf") is None
    (tmp_path / "out.gltf.0.bin").write_bytes(b"another")
    assert "is of another file" in remark(tmp_path / "out.gltf")


def test_inspect_tells_of_clips_and_frames(run):
    code, out, _ = run("inspect", "ball.glb", "--scheme", "relief")
    assert code == 0
    assert "note: clip 'Bend' is read; there is also 'Turn'" in out
    assert "/root/ball: 17 frames from 0 to 16, 642 points, 1280 faces" in out
    code, out, _ = run("inspect", "ball.glb", "--scheme", "relief", "--clip", "Turn", "--json")
    assert json.loads(out)["fps"] == 24
    assert json.loads(out)["prims"][0]["frames"] == 7


ATTACK = ["attack", "noise", "ball.glb", "-p", "amplitude=0.001", "--clip", "Turn", "-o"]


def test_an_attacked_clip_is_written_as_a_stage_or_a_new_file(run):
    assert run(*ATTACK, "x.usdc")[0] == 0
    asset = read("x.usdc")
    assert (asset.up_axis, asset.meters_per_unit, asset.fps) == ("Y", 1.0, 24.0)
    assert len(asset.meshes[0]) == 7
    assert run(*ATTACK, "x.glb")[0] == 0
    [same] = read("x.glb").meshes
    assert same.prim == asset.meshes[0].prim == "/root/ball"
    np.testing.assert_array_equal(same.times, asset.meshes[0].times)
    for one, two in zip(asset.meshes[0], same, strict=True):
        np.testing.assert_allclose(two.points, one.points, atol=1e-6)


@pytest.mark.slow
def test_a_stage_is_marked_into_a_new_file(run):
    assert run("attack", "noise", "ball.glb", "-o", "x.usda", "-p", "amplitude=0")[0] == 0
    code, out, _ = run("embed", "x.usda", "-o", "out.glb", *MARK, "--json")
    document = json.loads(out)
    assert code == 0
    jsonschema.validate(document, SCHEMA)
    assert document["verification"]["verdict"] == "marked"
    code, _, told = run("verify", "out.glb", "--original", "x.usda", *MARK)
    assert code == 0
    assert "out.glb: marked" in told


@pytest.mark.parametrize(
    ("arguments", "wanted"),
    [
        (
            ("embed", "packed.glb", "-o", "x.glb", *MARK),
            "is compressed by Draco, which is only read; --uncompress writes it plain",
        ),
        (("embed", "cube.usda", "-o", "x.usda", *MARK, "--uncompress"), "takes no uncompress"),
        (("embed", "ball.glb", "-o", "x.glb", *MARK, "--deliver"), "--deliver writes one of"),
        (("attack", "noise", "ball.glb", "-o", "x.ply"), "an attack's result is one of"),
        (
            ("inspect", "ball.glb", "--clip", "Crawl"),
            "ball.glb: no clip 'Crawl'; there is 'Bend', 'Turn'",
        ),
        (("inspect", "ball.glb", "--fps", "-1"), "--fps must be positive, not -1"),
        (("inspect", "ball.glb", "--fps", "1e9"), "fps must lie between 0 and 1000"),
        (("inspect", "cube.usda", "--clip", "Turn"), "cube.usda: its reader takes no clip"),
        (("verify", "cube.usda", "--clip", "Turn", "--key", "k"), "are for glTF files"),
        (("align", "cube.usda", "--original", "cube.usda", "--fps", "8"), "are for glTF files"),
        (("align", "ball.glb", "--original", "ball.glb", "--clip", "Crawl"), "no clip 'Crawl'"),
        (
            ("verify", "ball.glb", "--clip", "Crawl", *MARK[:2], "--evidence", "e"),
            "no clip 'Crawl'",
        ),
    ],
)
def test_what_cannot_be_done_is_one_line(run, tmp_path, arguments, wanted):
    write_text(tmp_path / "cube.usda", cube("m"))
    draco_quad().save(tmp_path / "packed.glb")
    before = set(tmp_path.iterdir())
    code, out, told = run(*arguments)
    assert code == 2
    assert out == ""
    assert wanted in told
    assert told.count("\n") == 1
    assert set(tmp_path.iterdir()) == before
