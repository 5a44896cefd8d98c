"""An override layer moves what is inside instances, all of a prototype alike; they stay such."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdSkel

from composed_stages import ARCS, CUBE, MODEL, write
from meshmark.delivery.unmarked import split_in_place
from meshmark.errors import CapacityError, OutputError
from meshmark.usd.reading import read_stage
from meshmark.usd.variants import Choice, select
from meshmark.usd.writing import write_override
from rigged_stages import Rigged, bent_tube
from stage_comparison import MOVED, differences
from usd_stages import moved


def stages(*files: Path | str) -> list[Usd.Stage]:
    return [Usd.Stage.Open(str(file)) for file in files]


def test_of_meshes_that_are_shared_one_is_marked(tmp_path: Path) -> None:
    asset = read_stage(ARCS["beside_instances"](tmp_path, CUBE))
    kept = split_in_place(asset)
    assert [mesh.prim for mesh in kept.meshes] == ["/plain/m", "/one/m"]
    assert kept.left_out == asset.left_out
    assert kept.meshes[1].notes[0].endswith("marks it, and like it 1 more")
    nested = asset.mesh("/set/in/m")
    assert nested.notes[0].endswith("marks it as it marks /one/m")
    # Whichever of them is asked for.
    assert split_in_place(replace(asset, meshes=(nested,))).meshes == (nested,)


def test_what_no_class_reaches_is_left_out(tmp_path: Path) -> None:
    asset = read_stage(ARCS["beside_instances"](tmp_path, CUBE))
    kept = split_in_place(asset, {"/plain/m"})
    assert [mesh.prim for mesh in kept.meshes] == ["/plain/m"]
    assert [each.prim for each in kept.left_out] == ["/one/m", "/set/in/m"]
    with pytest.raises(CapacityError, match="inside an instance"):
        split_in_place(asset, set())


def test_all_that_is_said_wins_over_other_inherits(tmp_path: Path) -> None:
    """Points that a class of the source says, too; in the order of the source, behind ours."""
    source = ARCS["shared_instances"](tmp_path, CUBE)
    write_override(read_stage(source), moved(read_stage(source)), tmp_path / "o.usda")
    [stage] = stages(tmp_path / "o.usda")
    prim = stage.GetPrimAtPath("/still")
    names = [path.name for path in prim.GetInherits().GetAllDirectInherits()]
    assert names[1:] == ["_still", "_red"]
    klass = stage.GetPrimAtPath("/_meshmark")
    assert klass.IsAbstract()
    assert klass.IsHidden()


def test_other_variants_of_an_instance_stay_as_they_are(tmp_path: Path) -> None:
    source = ARCS["instances_of_variants"](tmp_path, CUBE)
    original = read_stage(source)
    done = write_override(original, moved(original), tmp_path / "o.usda")
    told = {each["prim"]: each for each in done.as_json()["variants"]}
    assert told["/a/m"]["marked_in"] == [
        "/a{lod=high}", "/c{lod=high}", "/d{many=yes}", "/d/f{lod=high}"
    ]  # fmt: skip
    both = stages(source, tmp_path / "o.usda")
    marked = {mesh.prim: MOVED for mesh in original.meshes if mesh.prim != "/a/m"}
    # It inherits another class than the instances that select the same variant in the source.
    for name, told in (("low", ["other instances share a prototype"]), ("none", [])):
        for stage in both:
            select(stage, [Choice("/a", "lod", name)])
        assert differences(*both, marked) == told
    for stage in both:
        select(stage, [Choice("/a", "lod", "high"), Choice("/a", "colour", "blue")])
    assert differences(*both, {**marked, "/a/m": MOVED}) == []


def test_a_layer_over_a_marked_one_has_a_class_of_its_own(tmp_path: Path) -> None:
    """Also where the marked stage is referenced: USD lets classes of one name flow together."""
    write(tmp_path / "model.usda", f'def Xform "M"\n{{{CUBE.mesh()}}}', MODEL)
    body = 'def "{}" (references = @{}@{}\ninstanceable = true) {{}}\n'
    source = write(tmp_path / "a.usda", body.format("a", "model.usda", ""))
    write_override(read_stage(source), moved(read_stage(source)), tmp_path / "1.usda")
    scene = body.format("x", "1.usda", "</a>") + body.format("y", "1.usda", "</a>")
    for i, over in enumerate((tmp_path / "1.usda", write(tmp_path / "b.usda", scene))):
        original, output = read_stage(str(over)), tmp_path / f"over{i}.usda"
        write_override(original, moved(original), output)
        allowed = {mesh.prim: MOVED for mesh in original.meshes}
        assert differences(*stages(over, output), allowed) == []
        shown = read_stage(str(output)).meshes[0]
        for expected, frame in zip(moved(original).meshes[0], shown, strict=True):
            np.testing.assert_allclose(frame.points, expected.points, rtol=0, atol=1e-5)
        layer = Sdf.Layer.FindOrOpen(str(output))
        assert "_meshmark_2" in [prim.name for prim in layer.rootPrims]


def test_what_was_relocated_inside_an_instance(tmp_path: Path) -> None:
    write(tmp_path / "model.usda", f'def Xform "M"\n{{{CUBE.mesh()}}}', MODEL)
    body = 'def "S" { def "a" (references = @model.usda@) {}\ndef "b" {} }'
    write(tmp_path / "set.usda", body, 'defaultPrim = "S"\nrelocates = {</S/a/m>: </S/b/n>}')
    body = 'def "x" (references = @set.usda@\ninstanceable = true) {}'
    original = read_stage(write(tmp_path / "scene.usda", body))
    assert [mesh.prim for mesh in original.meshes] == ["/x/b/n"]
    write_override(original, moved(original), tmp_path / "o.usda")
    both = stages(tmp_path / "scene.usda", tmp_path / "o.usda")
    assert differences(*both, {"/x/b/n": MOVED}) == []
    assert differences(*both, {}) == ["/x/b/n extent", "/x/b/n points"]


def test_bytes_are_the_same_every_time(tmp_path: Path) -> None:
    """USD numbers prototypes as it happens to find them."""
    source = ARCS["shared_instances"](tmp_path, CUBE)
    marked = moved(read_stage(source))
    written = set()
    for i in range(6):
        write_override(read_stage(source), marked, tmp_path / f"{i}.usda")
        written.add((tmp_path / f"{i}.usda").read_bytes())
    assert len(written) == 1


def crowd(folder: Path) -> str:
    """Write two instances of a man that bends, one aside."""
    bent_tube(folder / "man.usda")
    man = "references = @man.usda@\ninstanceable = true"
    aside = "double3 xformOp:translate = (9, 0, 0)\n"
    aside += 'uniform token[] xformOpOrder = ["xformOp:translate"]'
    return write(folder / "crowd.usda", f'def "p" ({man}) {{}}\ndef "q" ({man}) {{ {aside} }}')


@pytest.mark.parametrize("skel", ["bake", "rest"])
def test_rigs_inside_instances(tmp_path: Path, skel: str) -> None:
    source = crowd(tmp_path)
    original = read_stage(source)
    write_override(original, moved(original), tmp_path / "o.usda", skel=skel)
    rig = {"skel:skeleton"} if skel == "bake" else {}
    weights = {"primvars:skel:jointIndices", "primvars:skel:jointWeights"} if not rig else {}
    allowed = dict.fromkeys(("/p/arm", "/q/arm"), MOVED.union(rig, weights))
    assert differences(*stages(source, tmp_path / "o.usda"), allowed) == []
    one, other = read_stage(str(tmp_path / "o.usda")).meshes
    for expected, p, q in zip(moved(original).meshes[0], one, other, strict=True):
        # One rest pose does not fit all the moves that a test makes at random.
        near = 1e-6 if skel == "bake" else 5e-3
        np.testing.assert_allclose(p.points, expected.points, rtol=0, atol=near)
        np.testing.assert_allclose(q.points - (9, 0, 0), p.points, rtol=0, atol=1e-5)


def test_instances_that_rigs_pose_in_their_own_ways(tmp_path: Path) -> None:
    """Bones are outside: those of one arm bend, those of the other do not."""
    rigged = Rigged.at(tmp_path / "arm.usda")
    rigged.add_tube()
    rigged.save()
    moving = Rigged.at(tmp_path / "scene.usda")
    moving.turn_elbow({1.0: 0.0, 2.0: 30.0})
    still = UsdSkel.Skeleton.Define(moving.stage, "/man/still")
    bones = moving.stage.GetPrimAtPath("/man/bones")
    for name in ("joints", "bindTransforms", "restTransforms"):
        still.GetPrim().GetAttribute(name).Set(bones.GetAttribute(name).Get())
    for name, bone in (("left", "/man/bones"), ("right", "/man/still")):
        prim = moving.stage.DefinePrim(f"/man/{name}")
        prim.GetReferences().AddReference("./part.usda")
        prim.SetInstanceable(True)
        UsdSkel.BindingAPI.Apply(prim).CreateSkeletonRel().SetTargets([bone])
    part = Usd.Stage.CreateNew(str(tmp_path / "part.usda"))
    part.SetDefaultPrim(part.DefinePrim("/part", "Xform"))
    Sdf.CopySpec(rigged.stage.GetRootLayer(), "/man/arm", part.GetRootLayer(), "/part/arm")
    part.GetPrimAtPath("/part/arm").RemoveProperty("skel:skeleton")
    part.GetRootLayer().Save()
    original = read_stage(moving.save())
    assert [mesh.in_place for mesh in original.meshes] == [False, False]
    assert "posed there in its own way" in original.meshes[0].notes[0]
    with pytest.raises(CapacityError, match="--deliver can mark it"):
        split_in_place(original)


def test_when_nothing_can_be_reached_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = read_stage(crowd(tmp_path))
    monkeypatch.setattr("meshmark.usd.trial.Trial._shows", lambda *_: False)
    with pytest.raises(OutputError, match="flattened deliverable instead"):
        write_override(original, moved(original), tmp_path / "o.usda")
    assert not (tmp_path / "o.usda").exists()
