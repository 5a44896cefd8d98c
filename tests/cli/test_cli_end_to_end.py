"""The whole way through the command line, on the creature: mark, look, leak, verify."""

from __future__ import annotations

import json
import stat
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom

from command_line import command
from meshmark import read
from meshmark.commands.attack import write_attacked
from meshmark.demo import creature
from meshmark.extension.registry import make_reader
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.testing.meshes import icosphere
from meshmark.testing.schemas import schema_folder

PRIM, BALL = "/Creature/Geom/body", Path("ball.usdc")
# Where layers do not matter, one is enough: test_cli_informed.py has both.
ALONE = ("--key", "k", "--scheme", "apex")


@pytest.fixture(scope="module")
def studio(tmp_path_factory) -> Path:
    """Return a folder with three frames of the creature, a key, and a marked layer."""
    folder = tmp_path_factory.mktemp("studio")
    short = creature(points=3000, frames=17).select([0, 8, 16])
    write_attacked(Asset("creature", (short,), "memory"), folder / "creature.usdc")
    Key(bytes(range(32))).save(folder / "k")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        code = command(patch, "embed", "creature.usdc", "-o", "marked.usda", "--key", "k")
    assert code == 0
    return folder


@pytest.fixture(scope="module")
def seven(studio) -> Path:
    """Return the first frame, marked for studio 7."""
    embed = ("embed", "creature.usdc", "-o", "seven.usdc", *ALONE, "--frames", "1:1")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(studio)
        assert command(patch, *embed, "--recipient", "studio 7") == 0
    return studio / "seven.usdc"


@pytest.fixture
def run(studio, monkeypatch, capsys):
    """Run the command line in the studio's folder."""
    monkeypatch.chdir(studio)

    def call(*arguments: object) -> tuple[int, str, str]:
        code = command(monkeypatch, *arguments)
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return call


def validate(document: object, name: str) -> None:
    schema = json.loads((schema_folder("json") / f"{name}.schema.json").read_text())
    jsonschema.validate(document, schema)


def test_keygen(run, tmp_path) -> None:
    code, out, err = run("keygen", tmp_path / "new.key")
    assert (code, out) == (0, "")
    assert Key.load(tmp_path / "new.key").id in err
    assert Key.load(tmp_path / "new.key").secret.hex() not in err
    assert stat.S_IMODE((tmp_path / "new.key").stat().st_mode) == 0o600


def test_inspect_foresees(run) -> None:
    code, out, _ = run("inspect", "creature.usdc", "--json")
    document = json.loads(out)
    validate(document, "inspect")
    [prim] = document["prims"]
    assert code == 0
    assert (prim["prim"], prim["frames"], prim["points"]) == (PRIM, 3, 3002)
    assert prim["can_hold"]
    assert prim["parts"] >= 6
    assert prim["reachable_log10_p"] < -6


@pytest.mark.slow
def test_align_finds_a_moved_copy_and_refuses_what_is_none(run) -> None:
    assert run("attack", "similarity", "marked.usda", "-o", "moved.usdc", "--seed", "3")[0] == 0
    code, out, err = run("align", "moved.usdc", "--original", "creature.usdc", "--json")
    document = json.loads(out)
    validate(document, "align")
    [mesh] = document["meshes"]
    assert (code, mesh["prim"], mesh["copy_prims"]) == (0, PRIM, [PRIM])
    assert [frame["original_time"] for frame in mesh["frames"]] == [1.0, 9.0, 17.0]
    there, here = (read(name).mesh(PRIM)[0].points for name in ("moved.usdc", "creature.usdc"))
    A = np.array(mesh["frames"][0]["similarity"]).reshape(4, 4)
    assert np.abs(there @ A[:3, :3].T + A[:3, 3] - here).mean() < 1e-2 * np.ptp(here)
    assert "1 of 1 mesh(es) found" in err

    write_attacked(Asset("ball", (MeshAnimation.from_arrays(*icosphere(3)),), "memory"), BALL)
    code, out, err = run("align", BALL, "--original", "creature.usdc")
    assert (code, out) == (4, "")
    assert "not found" in err
    assert run("align", "moved.usdc", "--original", "none.usdc")[0] == 3
    assert run("align", "moved.usdc", "--original", "creature.usdc", "--frames", "90:")[0] == 2


def test_the_marked_layer_holds_nothing_but_what_changed(studio) -> None:
    layer = Sdf.Layer.FindOrOpen(str(studio / "marked.usda"))
    specs: list[Sdf.Spec] = []
    layer.Traverse("/", lambda path: specs.append(layer.GetObjectAtPath(path)))
    prims = [spec for spec in specs if isinstance(spec, Sdf.PrimSpec) and spec.path != "/"]
    assert {spec.specifier for spec in prims} == {Sdf.SpecifierOver}
    attributes = [spec.path for spec in specs if isinstance(spec, Sdf.AttributeSpec)]
    assert sorted(map(str, attributes)) == [f"{PRIM}.extent", f"{PRIM}.points"]
    assert layer.ListTimeSamplesForPath(f"{PRIM}.points") == [1.0, 9.0, 17.0]
    assert list(layer.subLayerPaths) == ["./creature.usdc"]


def test_the_composed_points_differ_and_nothing_else(studio) -> None:
    stages = [Usd.Stage.Open(str(studio / name)) for name in ("creature.usdc", "marked.usda")]
    before, after = (UsdGeom.Mesh(stage.GetPrimAtPath(PRIM)) for stage in stages)
    for time in (1.0, 9.0, 17.0):
        old = np.asarray(before.GetPointsAttr().Get(time))
        new = np.asarray(after.GetPointsAttr().Get(time))
        assert old.shape == new.shape
        assert (old != new).any(axis=1).sum() > 1000
    for name in ("faceVertexCounts", "faceVertexIndices", "subdivisionScheme"):
        assert before.GetPrim().GetAttribute(name).Get() == after.GetPrim().GetAttribute(name).Get()


def test_the_manifest(run, studio) -> None:
    document = json.loads((studio / "marked.usda.meshmark.json").read_text())
    validate(document, "manifest")
    key = Key.load(studio / "k")
    assert document["key_id"] == key.id
    assert key.secret.hex() not in json.dumps(document)
    assert document["plugins"]["segmenter"]["parameters"]["rays"] == 25
    assert document["verification"]["verdict"] == "marked"
    [prim] = document["prims"]
    assert prim["distortion"]["flipped_faces"] == 0
    assert 0 < prim["distortion"]["mrms_rel"] < 1e-3


def test_verify(run) -> None:
    asked = ("verify", "marked.usda", "creature.usdc", "--key", "k", "--frames", ":", "--json")
    code, out, err = run(*asked)
    assert code == 1
    document = json.loads(out)
    validate(document, "verdict")
    marked, unmarked = document["assets"]
    assert (marked["verdict"], unmarked["verdict"]) == ("marked", "not marked")
    assert marked["log10_p"] <= -6 < -2 < unmarked["log10_p"]
    assert marked["prims"][0]["ber"]["max"] <= 0.125
    assert len(marked["prims"][0]["per_frame"]) == 3
    assert "marked.usda: marked" in err
    assert run("verify", "marked.usda", "--key", "k")[0] == 0


def test_a_wrong_key_finds_nothing(run, tmp_path) -> None:
    Key(bytes(32)).save(tmp_path / "wrong")
    assert run("verify", "marked.usda", "--key", tmp_path / "wrong", "--scheme", "tsai2014")[0] == 1


@pytest.mark.slow
def test_sixteen_shared_bits_as_published(run) -> None:
    shared = ("--scheme", "tsai2014", "--set", "words=1", "--frames", "1:1")
    code, _, err = run("embed", "creature.usdc", "-o", "shared.usdc", "--key", "k", *shared)
    assert code == 0
    assert "inconclusive at 1e-06" in err
    assert run("verify", "shared.usdc", "--key", "k", *shared)[0] == 4
    assert run("verify", "shared.usdc", "--key", "k", *shared, "--fpr", "1e-4")[0] == 0


def test_a_recipient_is_named(run, seven) -> None:
    asked = ("verify", seven, "--key", "k", "--frames", "1:1", "--json")
    code, out, _ = run(*asked, "--recipient", "west", "--recipient", "studio 7")
    assert code == 0
    assert json.loads(out)["assets"][0]["recipient"] == "studio 7"
    assert run(*asked)[0] == 1


def test_deliver_leaves_no_unmarked_point(run, studio) -> None:
    assert run("embed", "creature.usdc", "-o", "sent.usdc", *ALONE, "--deliver")[0] == 0
    sent = Sdf.Layer.FindOrOpen(str(studio / "sent.usdc"))
    assert not sent.subLayerPaths
    stage = Usd.Stage.Open(str(studio / "creature.usdc"))
    source = UsdGeom.Mesh(stage.GetPrimAtPath(PRIM))
    unmarked = {np.asarray(source.GetPointsAttr().Get(time)).tobytes() for time in (1.0, 9.0, 17.0)}
    points = f"{PRIM}.points"
    arrays = [sent.QueryTimeSample(points, time) for time in sent.ListTimeSamplesForPath(points)]
    default = sent.GetAttributeAtPath(points).default
    arrays += [] if default is None else [default]
    assert len(arrays) == 3
    assert not unmarked & {np.asarray(array).tobytes() for array in arrays}
    assert run("verify", "sent.usdc", "--key", "k", "--scheme", "apex")[0] == 0


def test_a_dry_run_writes_nothing(run, studio) -> None:
    before = sorted(studio.iterdir())
    embed = ("embed", "creature.usdc", "-o", "dry.usda", *ALONE, "--frames", "1:1")
    code, out, err = run(*embed, "--dry-run", "--json")
    assert code == 0
    validate(json.loads(out), "manifest")
    assert "nothing was written" in err
    assert sorted(studio.iterdir()) == before


def test_capital_suffixes_are_suffixes_on_the_command_line(run, tmp_path) -> None:
    embed = ("embed", "creature.usdc", "--key", "k", "--scheme", "relief", "--frames", "1:1")
    assert run(*embed, "-o", tmp_path / "OUT.USDA")[0] == 0
    assert (tmp_path / "OUT.USDA").read_text().startswith("#usda")


def test_two_runs_are_byte_equal(run, studio, seven, tmp_path) -> None:
    embed = ("embed", "creature.usdc", *ALONE, "--frames", "1:1", "--recipient", "studio 7")
    written = {path: path.read_bytes() for path in studio.glob("seven.usdc*")}
    assert len(written) == 2
    for path in written:
        path.rename(tmp_path / path.name)
    assert run(*embed, "-o", "seven.usdc")[0] == 0
    assert {path: path.read_bytes() for path in studio.glob("seven.usdc*")} == written


def test_segment_shows_the_parts(run, studio) -> None:
    assert run("segment", "creature.usdc", "-o", "parts.usda")[0] == 0
    stage = Usd.Stage.Open(str(studio / "parts.usda"))
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(PRIM))
    subsets = UsdGeom.Subset.GetGeomSubsets(mesh, UsdGeom.Tokens.face, "parts")
    assert len(subsets) == 7
    n_faces = len(mesh.GetFaceVertexCountsAttr().Get())
    valid, reason = UsdGeom.Subset.ValidateFamily(mesh, UsdGeom.Tokens.face, "parts")
    assert valid, reason
    colours = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("displayColor").Get()
    assert len(colours) == n_faces
    assert len(set(map(tuple, np.asarray(colours)))) == 7


def test_a_leak_is_still_found(run) -> None:
    attack = ("attack", "noise", "marked.usda", "-o", "leak.usdc", "-p", "amplitude=0.0005")
    assert run(*attack, "-p", "kind=gaussian", "--seed", "3")[0] == 0
    assert run("verify", "leak.usdc", "--key", "k", "--scheme", "apex")[0] == 0


@pytest.mark.slow
def test_obj_frames_in_and_out(run, studio) -> None:
    short = Asset("creature", (creature(points=3000, frames=17).select([0, 12]),), "memory")
    make_reader("obj").write_new(short, studio / "frames")
    assert run("embed", "frames", "-o", "frames-marked", *ALONE)[0] == 0
    names = sorted(path.name for path in (studio / "frames").iterdir())
    assert sorted(path.name for path in (studio / "frames-marked").iterdir()) == names
    assert run("verify", "frames-marked", "--key", "k", "--scheme", "apex")[0] == 0
    assert run("embed", "frames", "-o", "frames.usda", *ALONE, "--frames", "1:1")[0] == 0
    assert len(read(studio / "frames.usda").meshes[0]) == 2
    assert run("verify", "frames", "--key", "k", "--scheme", "apex")[0] == 1


def test_plugins_are_listed_and_checked(run) -> None:
    code, out, _ = run("plugins", "list", "--json")
    assert code == 0
    names = {(entry["kind"], entry["name"]) for entry in json.loads(out)["plugins"]}
    assert {("scheme", "tsai2014"), ("segmenter", "sdf"), ("geodesic", "exact")} <= names
    for name in ("sdf", "heat", "tsai2014", "noise", "obj"):
        assert run("plugins", "check", name)[0] == 0, name


@pytest.mark.slow
def test_the_demo_tells_its_story(monkeypatch, capsys, tmp_path) -> None:
    from meshmark.demo import story

    monkeypatch.setattr(story, "FRAMES", 3)
    assert command(monkeypatch, "demo", tmp_path / "demo") == 0
    told = capsys.readouterr().out
    rows = {line[:42].strip(): line[42:].split() for line in told.splitlines()}
    assert rows["the original, unmarked"][:2] == ["not", "marked"]
    assert rows["the marked copy"][0] == "marked"
    assert rows["the marked copy, a wrong key"][:2] == ["not", "marked"]
    assert sum(label.startswith("a leaked copy: ") for label in rows) == 2


def test_evidence_is_measured_once_and_tried_again(run, studio) -> None:
    asked = ("verify", "marked.usda", "--key", "k", "--scheme", "apex", "--evidence", "e", "--json")
    first = json.loads(run(*asked)[1])["assets"][0]
    written = (studio / "e").read_bytes()
    assert Key.load(studio / "k").secret not in written
    again = json.loads(run(*asked)[1])["assets"][0]
    for found in (first, again):
        found.pop("elapsed_s")
    assert again == first
    assert (studio / "e").read_bytes() == written
    code, _, err = run(
        "verify", "creature.usdc", "--key", "k", "--scheme", "apex", "--evidence", "e"
    )
    assert code == 2
    assert "another file" in err
    code, _, err = run(*asked, "--set", "width=0.05")
    assert code == 2
    assert "other schemes or parameters" in err
    code, _, err = run(*asked, "--frames", "1:9")
    assert code == 2
    assert "other frames" in err


def test_broken_evidence_is_refused(run, studio) -> None:
    asked = ("verify", "marked.usda", "--key", "k", "--scheme", "apex", "--evidence", "broken")
    (studio / "broken").write_bytes(b"PK not at all")
    code, _, err = run(*asked)
    assert code == 3
    assert "older version" in err
    assert "Traceback" not in err


@pytest.mark.slow
def test_evidence_of_another_machine_is_for_information_only(run, studio, monkeypatch) -> None:
    asked = ("verify", "marked.usda", "--key", "k", "--scheme", "apex", "--evidence", "theirs")
    assert run(*asked)[0] == 0
    monkeypatch.setenv("MESHMARK_EVIDENCE_SECRET", str(studio / "secret"))
    (studio / "secret").write_text("meshmark-evidence-secret-1\n" + "0" * 64 + "\n")
    code, _, err = run(*asked)
    assert code == 3
    assert "not authentic" in err
    code, out, err = run(*asked, "--unauthenticated-evidence", "--json")
    assert code == 4
    assert "unauthenticated, not for verdicts: it says marked" in err
    document = json.loads(out)
    validate(document, "verdict")
    [asset] = document["assets"]
    assert (asset["verdict"], asset["log10_p"], asset["prims"]) == ("inconclusive", 0.0, [])
    assert asset["unauthenticated"]["verdict"] == "marked"
    assert run("verify", "marked.usda", "--key", "k", "--unauthenticated-evidence")[0] == 2


@pytest.mark.slow
def test_recipients_come_from_a_file(run, studio, seven) -> None:
    names = [f"studio {i}" for i in range(200)]
    (studio / "names").write_text("# who got it\n\n" + "\n".join(names) + "\n")
    asked = ("verify", seven, "--scheme", "apex", "--frames", "1:1", "--json", "--evidence")
    found = []
    # Measured at first, then read from the file.
    for more in (("--recipient", "@names"), ("--recipient", "@names"), ()):
        code, out, _ = run(*asked, "seven.evidence", "--key", "k", *more)
        [asset] = json.loads(out)["assets"]
        found.append((code, asset["verdict"], asset["recipient"], asset["log10_p"]))
    assert found[0] == found[1]
    assert found[0][:3] == (0, "marked", "studio 7")
    assert found[2][:3] == (1, "not marked", None)
    Key(bytes(range(1, 33))).save(studio / "other")
    assert run(*asked, "others.evidence", "--key", "other", "--recipient", "studio 7")[0] == 1
    # Evidence is the file's alone: no key, no name, and no hour goes into it.
    assert (studio / "others.evidence").read_bytes() == (studio / "seven.evidence").read_bytes()
    code, _, err = run(*asked, "seven.evidence", "--key", "k", "--recipient", "@nowhere")
    assert code == 3
    assert "nowhere" in err


def test_few_frames_decide_and_pay_for_the_looks(run) -> None:
    asked = ("verify", "marked.usda", "--key", "k", "--scheme", "apex", "--json")
    first, whole = (
        json.loads(run(*asked, "--frames", frames)[1])["assets"][0] for frames in ("auto", ":")
    )
    assert first["verdict"] == whole["verdict"] == "marked"
    assert first["prims"][0]["frames"] < whole["prims"][0]["frames"] == 3
    # An eighth of the rate was for this look.
    [frame] = first["prims"][0]["per_frame"]
    assert first["log10_p"] == pytest.approx(frame["log10_p"] + np.log10(8), abs=1e-9)


def test_distortion_is_kept_within_its_limit(run, studio) -> None:
    embed = ("embed", "creature.usdc", "--key", "k", "-o", "faint.usdc", "--max-mrms", "5e-5")
    assert run(*embed, "--scheme", "apex", "--frames", "1:1")[0] == 0
    [prim] = json.loads((studio / "faint.usdc.meshmark.json").read_text())["prims"]
    # Measured on samples of the surface, once for the limit and once more for the manifest.
    assert 3e-5 < prim["distortion"]["mrms_rel"] < 5.5e-5
    code, _, err = run(*embed, "--scheme", "tsai2014")
    assert code == 2
    assert "max_mrms" in err


@pytest.mark.slow
def test_what_does_not_move_is_in_every_range(run, studio) -> None:
    floor = """
    def Mesh "Floor"
    {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(0, 0, 0), (9, 0, 0), (9, 0, 9), (0, 0, 9)]
    }
    """
    for name, below in (("leak", "marked.usda"), ("set", "creature.usdc")):
        text = f"#usda 1.0\n(\n    subLayers = [@./{below}@]\n)\n{floor}"
        (studio / f"{name}.usda").write_text(text)
    code, _, err = run("verify", "leak.usda", "--key", "k", "--scheme", "apex", "--frames", "9:9")
    assert code == 0, err
    code, _, err = run("embed", "set.usda", "-o", "o.usda", *ALONE, "--frames", "9:9")
    assert code == 1, err
    assert "/Floor: not marked: " in err
    manifest = json.loads((studio / "o.usda.meshmark.json").read_text())
    assert [prim["marked_frames"] for prim in manifest["prims"]] == [1]
