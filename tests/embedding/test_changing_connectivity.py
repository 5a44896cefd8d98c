"""A mesh whose connectivity changes is marked run by run, and found in every kind of copy."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, Vt

from meshmark import verify
from meshmark.commands.attack import attack_asset, make_attack
from meshmark.commands.inspect import inspect_asset
from meshmark.detection.informed_pairs import pairs, run_named
from meshmark.embedding.asset import embed
from meshmark.embedding.file import mark_file
from meshmark.embedding.manifest import manifest_path
from meshmark.errors import CapacityError
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.mesh.topology import Topology
from meshmark.testing.meshes import bumpy_sphere, icosphere, torus
from meshmark.testing.schemas import schema_folder
from meshmark.usd.checking import check_stage
from meshmark.usd.reading import read_stage
from meshmark.usd.stages import write_stage

KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))
BLIND, BESIDE = Recipe("cho2007"), Recipe("relief")
PRIM = "/World/sim"
RING = torus(48, 20)
SHAPES = {
    "ball": bumpy_sphere(3, np.eye(3)),
    "ring": (RING[0] * [1.3, 1.0, 0.8] + 0.05 * np.sin(5 * RING[0][:, [1, 2, 0]]), RING[1]),
    "cube": icosphere(0),
}


def simulation(names: list[str]) -> MeshAnimation:
    """Return a mesh that grows, and is another in every frame that is called another."""
    frames = []
    for t, name in enumerate(names, start=1):
        V, F = SHAPES[name]
        topology = Topology.from_triangles(F, len(V))
        frames.append(Frame(float(t), (1 + 0.1 * t) * V, topology))
    return MeshAnimation.from_frames(frames, prim=PRIM)


def stage(path: Path, names: list[str]) -> Path:
    write_stage(as_asset(simulation(names)), path)
    return path


@dataclass(frozen=True)
class Marked:
    """A source of three runs, and what was written of it."""

    source: Path
    output: Path
    master: Path


@pytest.fixture(scope="module", params=["out.usdc", "over.usda"])
def marked(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Marked:
    """Return a deliverable, or an override, with its source and master: two layers."""
    folder = tmp_path_factory.mktemp("studio")
    source = stage(folder / "s.usda", ["ball", "ball", "ring", "ball"])
    files = Marked(source, folder / request.param, folder / "master.usdc")
    mark_file(
        source,
        files.output,
        KEY,
        recipe=[BLIND, BESIDE],
        recipient="acme",
        master=files.master,
        deliver=files.output.suffix == ".usdc",
    )
    return files


@pytest.mark.slow
def test_the_manifest_tells_of_all_frames(marked: Marked) -> None:
    document = json.loads(manifest_path(marked.output).read_text())
    schema = json.loads((schema_folder("json") / "manifest.schema.json").read_text())
    jsonschema.validate(document, schema)
    [prim] = document["prims"]
    assert (prim["frames"], prim["marked_frames"], prim["passed_over"]) == (4, 4, [])
    assert [layer["scheme"] for layer in prim["layers"]] == ["cho2007", "relief"]
    # One carrier for each of three runs.
    assert prim["layers"][0]["carriers"] == 3
    assert document["verification"]["log10_p"] < -20


@pytest.mark.parametrize("name", ["out.usdc", "over.usda"])
def test_only_points_are_moved(tmp_path: Path, name: str) -> None:
    source, output = stage(tmp_path / "s.usda", ["ball", "ring", "ring"]), tmp_path / name
    opened = Usd.Stage.Open(str(source))
    mesh = UsdGeom.Mesh(opened.GetPrimAtPath(PRIM))
    for time in (1, 2, 3):
        upward = Vt.Vec3fArray(len(mesh.GetPointsAttr().Get(time)), Gf.Vec3f(0, 1, 0))
        for attribute in (mesh.CreateVelocitiesAttr(), mesh.CreateNormalsAttr()):
            attribute.Set(upward, time)
    opened.Save()
    mark_file(source, output, KEY, recipe=BLIND, deliver=name == "out.usdc")
    stages = [Usd.Stage.Open(str(each)) for each in (source, output)]
    before, after = (UsdGeom.Mesh(each.GetPrimAtPath(PRIM)) for each in stages)
    assert after.GetPointsAttr().GetTimeSamples() == [1, 2, 3]
    for time in (1, 2, 3):
        faces = [each.GetFaceVertexIndicesAttr().Get(time) for each in (before, after)]
        assert np.array_equal(*faces)
        for hanging in ("velocities", "normals"):
            left = [each.GetPrim().GetAttribute(hanging).Get(time) for each in (before, after)]
            assert left[0] == left[1]
        P, Q = (np.array(each.GetPointsAttr().Get(time)) for each in (before, after))
        assert P.shape == Q.shape
        assert 0 < np.abs(P - Q).max() < 0.03 * np.ptp(P, axis=0).max()
    given_away = {each.kind for each in check_stage(str(output), [PRIM])}
    assert given_away == (set() if name == "out.usdc" else {"layer"})


def test_a_copy_of_one_run_is_moved_along(tmp_path: Path) -> None:
    source, output = stage(tmp_path / "s.usda", ["ball", "ring", "ring"]), tmp_path / "o.usda"
    opened = Usd.Stage.Open(str(source))
    unmarked = UsdGeom.Mesh(opened.GetPrimAtPath(PRIM)).GetPointsAttr().Get(2)
    points = UsdGeom.Points.Define(opened, "/World/cloud").CreatePointsAttr(unmarked)
    opened.Save()
    document = mark_file(source, output, KEY, recipe=BLIND, deliver=True).document
    assert document["delivery"]["moved"] == [{"path": str(points.GetPath()), "prim": PRIM}]
    opened = Usd.Stage.Open(str(output))
    moved = np.array(opened.GetAttributeAtPath(points.GetPath()).Get())
    marked = UsdGeom.Mesh(opened.GetPrimAtPath(PRIM)).GetPointsAttr().Get(2)
    np.testing.assert_allclose(moved, np.array(marked), atol=1e-6)
    assert np.abs(moved - np.array(unmarked)).max() > 1e-4


@pytest.mark.parametrize("renumbered", [False, True])
def test_each_run_is_laid_beside_its_own(renumbered: bool) -> None:
    original = simulation(["ball", "ball", "ring", "cube"])
    copy = original.select([1, 2, 3])
    if renumbered:
        copy = replace(copy, times=copy.times + 1000)
    found = pairs(as_asset(copy), as_asset(original))
    assert [pair.part for pair in found] == ["frames 1:2", "frames 3:3", "frames 4:4"]
    for pair in found:
        named = run_named(original, pair.part)
        np.testing.assert_array_equal(named.times, pair.original.meshes[0].times)
        assert named.constant_topology
    assert run_named(original, "") is original
    shown = [[frame.topology.n_points for frame in pair.copy.meshes[0]] for pair in found]
    assert shown == [[len(SHAPES[name][0])] for name in ("ball", "ring", "cube")]


def test_meshes_that_do_not_change_are_read_together_beside_it() -> None:
    still = MeshAnimation.from_arrays(*SHAPES["ball"], prim="/World/ball")
    whole = Asset("s", (simulation(["ball", "ring"]), still), "test")
    together, *each_run = pairs(whole, whole)
    assert together.copy is whole
    assert together.original.meshes == (still,)
    assert [pair.part for pair in each_run] == ["frames 1:1", "frames 2:2"]
    assert pairs(whole, as_asset(still))[0].part == ""


def test_a_remeshed_run_is_looked_for_at_its_time() -> None:
    original, copy = simulation(["ring", "ball", "ball"]), simulation(["cube", "cube", "ring"])
    found = pairs(as_asset(copy), as_asset(original))
    assert [pair.copy.meshes[0].times.tolist() for pair in found] == [[3], [2, 3]]


@pytest.mark.slow
def test_it_is_found_beside_the_original(marked: Marked) -> None:
    original, copy, master = map(read_stage, map(str, vars(marked).values()))
    asked = {"recipes": [BESIDE], "recipients": ["acme", "globex"], "original": original}
    found = {key: verify(copy, key, master=master, **asked) for key in (KEY, OTHER)}
    assert (found[KEY].verdict, found[KEY].recipient) == ("marked", "acme")
    assert found[OTHER].verdict == "not marked"
    assert [(each.scheme, each.meshes) for each in found[KEY].pooled] == [("relief", 3)]
    [prim] = found[KEY].prims
    assert prim.part in ("frames 1:2", "frames 3:3", "frames 4:4")


@pytest.mark.slow
def test_a_part_of_the_frames_is_found(marked: Marked) -> None:
    """As a leak is that was cut, and whose frames are counted from another number."""
    original, copy, master = map(read_stage, map(str, vars(marked).values()))
    late = copy.meshes[0].select([2, 3])
    leak = MeshAnimation(late.times + 1000, late.source, False, prim="/other")
    asked = {"recipes": [BESIDE], "recipients": ["acme"], "original": original}
    assert verify(leak, KEY, master=master, **asked).recipient == "acme"


@pytest.mark.slow
def test_the_unmarked_source_is_not_found(marked: Marked) -> None:
    original = read_stage(str(marked.source))
    found = verify(original, KEY, recipes=[BESIDE], original=original, recipients=["acme"])
    assert found.verdict == "not marked"


def test_it_is_found_by_itself() -> None:
    source = simulation(["ball", "ball", "ring", "ball"])
    copy = embed(source, KEY, recipe=BLIND).asset
    assert verify(copy, KEY, recipes=[BLIND]).verdict == "marked"
    assert verify(copy, OTHER, recipes=[BLIND]).verdict == "not marked"
    assert verify(source, KEY, recipes=[BLIND]).verdict == "not marked"


def test_runs_that_can_hold_nothing_stay_as_they_are(tmp_path: Path) -> None:
    source = stage(tmp_path / "s.usda", ["ball", "cube", "cube", "ring"])
    marked = embed(read_stage(str(source)), KEY, recipe=BESIDE)
    [mesh] = marked.meshes
    assert mesh.frames == (0, 3)
    assert [time for time, _ in mesh.passed_over] == [2, 3]
    for index in range(4):
        moved = np.any(mesh.animation[index].points != mesh.original[index].points)
        assert moved == (index in mesh.frames)
    with pytest.raises(CapacityError, match=r"frame 2: .* --allow-unmarked /World/sim"):
        mark_file(source, tmp_path / "o.usda", KEY, recipe=BESIDE, deliver=True)


def test_a_mesh_whose_every_run_is_too_small_says_why() -> None:
    with pytest.raises(CapacityError, match="points"):
        embed(simulation(["cube", "ball"]).select([0]), KEY, recipe=BESIDE)
    tiny = simulation(["cube", "ring"]).select([0])
    with pytest.raises(CapacityError):
        embed(MeshAnimation(tiny.times, tiny.source, False), KEY, recipe=BESIDE)


def test_inspect_tells_the_runs() -> None:
    asset = Asset("s", (simulation(["cube", "ball", "ball", "ring"]),), "test")
    document = inspect_asset(asset, [BLIND, BESIDE])
    schema = json.loads((schema_folder("json") / "inspect.schema.json").read_text())
    jsonschema.validate(document, schema)
    [prim] = document["prims"]
    assert (prim["can_hold"], prim["constant_topology"], prim["frames"]) == (True, False, 4)
    assert prim["points"] == len(SHAPES["ball"][0])
    told = [(run["first"], run["last"], run["frames"]) for run in prim["runs"]]
    assert told == [(1, 1, 1), (2, 3, 2), (4, 4, 1)]
    assert [run["reason"] is None for run in prim["runs"]] == [False, True, True]


@pytest.mark.slow
def test_a_horse_that_is_simplified_and_remeshed_on_its_way(
    tmp_path: Path, data_folder: Path
) -> None:
    """Two frames as they are, two simplified, two remeshed, with faces of their own each."""
    asset = read_stage(str(data_folder / "horse-gallop.usdc"))
    frames: list[Frame] = []
    for attack in (None, "simplification", "remeshing-sdf"):
        two = asset.meshes[0].select([len(frames), len(frames) + 1])
        part = replace(asset, meshes=(two,))
        frames += (part if attack is None else attack_asset(part, make_attack(attack), 0)).meshes[0]
    horse = MeshAnimation.from_frames(frames, prim=PRIM)
    assert len({frame.topology.n_points for frame in horse}) == 3
    source, output = tmp_path / "horse.usdc", tmp_path / "out.usdc"
    write_stage(as_asset(horse), source)
    mark_file(source, output, KEY, recipe=BESIDE, deliver=True)
    original, copy = read_stage(str(source)), read_stage(str(output))
    for before, after in zip(original.meshes[0], copy.meshes[0], strict=True):
        assert before.topology.digest() == after.topology.digest()
        moves = np.abs(after.points - before.points).max()
        assert 0 < moves < 0.01 * np.ptp(before.points, axis=0).max()
    found = [
        verify(copy, key, recipes=[BESIDE], original=original, frames="auto")
        for key in (KEY, OTHER)
    ]
    assert [each.verdict for each in found] == ["marked", "not marked"]
    assert found[0].log10_p < -100
