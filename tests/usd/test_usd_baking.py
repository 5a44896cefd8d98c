"""A marked rigged mesh is baked: the stage shows what was marked, and nothing poses it again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import Frame
from meshmark.mesh.asset import Asset
from meshmark.usd.checking import check_stage
from meshmark.usd.delivery import write_flattened
from meshmark.usd.opening import stage_files
from meshmark.usd.reach import files_in_reach
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from rigged_stages import (
    BENDS,
    Rigged,
    baked_by_usd,
    bent,
    bent_tube,
    elbow_weights,
    rotation,
    tube,
)
from usd_stages import moved, points_at, read_one

Write = Callable[[Asset, Asset, Path], object]
WRITERS = [write_override, write_flattened]
# What baking changes of a prim.
BAKED = {"points", "extent", "normals"}


def normals_of(stage: Usd.Stage, prim: str, time: float) -> np.ndarray:
    return np.array(stage.GetPrimAtPath(prim).GetAttribute("normals").Get(time))


def values(stage: Usd.Stage, times: list[float]) -> dict[str, list[object]]:
    """Return all that a stage authors: values at all times, targets, types."""
    found: dict[str, list[object]] = {}
    for prim in stage.TraverseAll():
        found[str(prim.GetPath())] = [prim.GetTypeName(), prim.GetAppliedSchemas()]
        for attribute in prim.GetAuthoredAttributes():
            codes = [Usd.TimeCode.Default(), *times]
            found[str(attribute.GetPath())] = [
                attribute.GetTimeSamples(),
                *(attribute.Get(code) for code in codes),
            ]
        for relationship in prim.GetAuthoredRelationships():
            found[str(relationship.GetPath())] = [relationship.GetTargets()]
    return found


@pytest.mark.parametrize("write", WRITERS)
@pytest.mark.parametrize("inherited", [False, True])
def test_the_stage_shows_the_marked_points_and_no_second_skinning(
    tmp_path: Path, write: Write, inherited: bool
) -> None:
    source = bent_tube(tmp_path / "a.usda", inherited=inherited)
    original = read_stage(source)
    marked = moved(original)
    output = tmp_path / "o.usda"
    write(original, marked, output)
    again = read_one(str(output))
    assert again.notes == ()
    assert again.times.tolist() == list(BENDS)
    for before, after in zip(marked.meshes[0], again, strict=True):
        np.testing.assert_array_equal(after.points, before.points.astype(np.float32))
    shown = Usd.Stage.Open(str(output))
    baked = baked_by_usd(str(output))
    for time in BENDS:
        written = points_at(shown, "/man/arm", time)
        np.testing.assert_array_equal(points_at(baked, "/man/arm", time), written)
        box = shown.GetPrimAtPath("/man/arm").GetAttribute("extent").Get(time)
        np.testing.assert_array_equal(box, [written.min(0), written.max(0)])


def test_points_that_do_not_move_keep_the_bits_of_usd_s_own_baking(tmp_path: Path) -> None:
    source = bent_tube(tmp_path / "a.usda")
    original = read_stage(source)
    write_override(original, moved(original), tmp_path / "o.usda")
    baked, shown = baked_by_usd(source), Usd.Stage.Open(str(tmp_path / "o.usda"))
    for time in BENDS:
        a, b = (points_at(stage, "/man/arm", time) for stage in (baked, shown))
        np.testing.assert_array_equal(a[::2], b[::2])
        assert (a[1::2] != b[1::2]).any(axis=1).all()


def test_nothing_else_changes(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    rigged.add_tube(inherited=True)
    rigged.add_tube("/man/leg")
    rigged.turn_elbow(BENDS)
    source = rigged.save()
    original = read_stage(source)
    one = replace(original, meshes=tuple(m for m in original.meshes if m.prim == "/man/arm"))
    write_override(original, moved(one), tmp_path / "o.usda")
    times = [*BENDS, 1.5]
    before = values(Usd.Stage.Open(source), times)
    after = values(Usd.Stage.Open(str(tmp_path / "o.usda")), times)
    different = {path for path in before | after if before.get(path) != after.get(path)}
    assert different == {"/man/arm.points", "/man/arm.extent", "/man/arm.skel:skeleton"}
    assert after["/man/arm.skel:skeleton"] == [[]]
    # What is not marked is posed as before.
    leg = next(mesh for mesh in read_stage(str(tmp_path / "o.usda")).meshes if "leg" in mesh.prim)
    assert leg.notes == ("rigged: posed by /man/bones",)


def test_a_mesh_that_does_not_say_it_can_be_bound_says_so_to_be_taken_away(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    mesh = rigged.add_tube(inherited=True).GetPrim()
    root = rigged.stage.GetPrimAtPath("/man")
    for name in ("jointIndices", "jointWeights"):
        attribute = mesh.GetAttribute(f"primvars:skel:{name}")
        create = getattr(UsdSkel.BindingAPI(root), f"Create{name[0].upper()}{name[1:]}Primvar")
        create(False, 2).Set(attribute.Get())
        mesh.RemoveProperty(attribute.GetName())
    mesh.RemoveAPI(UsdSkel.BindingAPI)
    rigged.turn_elbow(BENDS)
    original = read_stage(rigged.save())
    assert original.meshes[0].notes
    write_override(original, moved(original), tmp_path / "o.usda")
    shown = Usd.Stage.Open(str(tmp_path / "o.usda"))
    assert shown.GetPrimAtPath("/man/arm").HasAPI(UsdSkel.BindingAPI)
    assert read_one(str(tmp_path / "o.usda")).notes == ()


@pytest.mark.parametrize("interpolation", ["vertex", "faceVarying"])
@pytest.mark.parametrize("method", ["classicLinear", "dualQuaternion"])
def test_normals_are_those_of_usd_s_own_baking(
    tmp_path: Path, interpolation: str, method: str
) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    mesh = rigged.add_tube()
    binding = UsdSkel.BindingAPI(mesh.GetPrim())
    binding.CreateSkinningMethodAttr(method)
    out = tube()[0] * [0, 5, 5]
    corners = tube()[2] if interpolation == "faceVarying" else np.arange(len(out))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(out[corners].astype(np.float32)))
    mesh.SetNormalsInterpolation(interpolation)
    UsdGeom.XformCommonAPI(mesh).SetScale((1, 2, 3))
    rigged.turn_elbow(BENDS)
    source = rigged.save()
    original = read_stage(source)
    write_override(original, moved(original), tmp_path / "o.usda", primvars="keep")
    shown, baked = Usd.Stage.Open(str(tmp_path / "o.usda")), baked_by_usd(source)
    for time in BENDS:
        a, b = (normals_of(stage, "/man/arm", time) for stage in (shown, baked))
        np.testing.assert_allclose(a, b, atol=1e-6)
    # By hand, at the end of the tube, which turns as a whole.
    if interpolation == "vertex":
        stiff = elbow_weights(tube()[0]) == 1
        expected = out[stiff] @ rotation((0, 0, 1), 90) * [1, 2, 3]
        np.testing.assert_allclose(normals_of(shown, "/man/arm", 4)[stiff], expected, atol=1e-6)


def test_blend_shapes_turn_normals_as_usd_s_own_baking_does(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    mesh = rigged.add_tube()
    out = tube()[0] * [0, 5, 5]
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(out.astype(np.float32)))
    mesh.SetNormalsInterpolation("vertex")
    noise = np.random.default_rng(1).normal(0, 0.1, (4, *out.shape)).astype(np.float32)
    rigged.add_shape(mesh, noise[0], noise[1], {1: 0, 2: 0.3, 4: 0.8})
    shape = UsdSkel.BlendShape(rigged.stage.GetPrimAtPath("/man/arm/smile"))
    shape.CreateNormalOffsetsAttr(Vt.Vec3fArray.FromNumpy(noise[2]))
    shape.GetInbetween("half").SetNormalOffsets(Vt.Vec3fArray.FromNumpy(noise[3]))
    rigged.turn_elbow(BENDS)
    source = rigged.save()
    original = read_stage(source)
    write_override(original, moved(original), tmp_path / "o.usda", primvars="keep")
    shown, baked = Usd.Stage.Open(str(tmp_path / "o.usda")), baked_by_usd(source)
    for time in BENDS:
        a, b = (normals_of(stage, "/man/arm", time) for stage in (shown, baked))
        np.testing.assert_allclose(a, b, atol=1e-6)


def bent_moves(asset: Asset, moves: np.ndarray) -> Asset:
    """Move the tube as if its rest pose had been moved."""
    w = elbow_weights(tube()[0])[:, None]

    def move(frame: Frame) -> Frame:
        turned = moves @ rotation((0, 0, 1), BENDS[frame.time])
        return frame.moved(frame.points + (1 - w) * moves + w * turned)

    return replace(asset, meshes=tuple(mesh.map(move) for mesh in asset.meshes))


def test_the_default_is_the_rest_pose_that_poses_into_the_marked_points(tmp_path: Path) -> None:
    source = bent_tube(tmp_path / "a.usda")
    original = read_stage(source)
    moves = np.random.default_rng(5).normal(0, 1e-3, tube()[0].shape)
    write_override(original, bent_moves(original, moves), tmp_path / "o.usda")
    rest = points_at(Usd.Stage.Open(str(tmp_path / "o.usda")), "/man/arm")
    np.testing.assert_allclose(rest, tube()[0] + moves, atol=2e-6)


def test_copies_of_the_rest_pose_are_marked_in_a_deliverable(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    mesh = rigged.add_tube()
    reference = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "Pref", Sdf.ValueTypeNames.Point3fArray, UsdGeom.Tokens.vertex
    )
    reference.Set(mesh.GetPointsAttr().Get())
    rigged.turn_elbow(BENDS)
    source = rigged.save()
    original = read_stage(source)
    moves = np.random.default_rng(5).normal(0, 1e-3, tube()[0].shape)
    delivery = write_flattened(original, bent_moves(original, moves), tmp_path / "o.usda")
    assert [each.path for each in delivery.moved] == ["/man/arm.primvars:Pref"]
    stage = Usd.Stage.Open(str(tmp_path / "o.usda"))
    kept = np.array(stage.GetPrimAtPath("/man/arm").GetAttribute("primvars:Pref").Get())
    np.testing.assert_allclose(kept, tube()[0] + moves, atol=1e-5)
    assert check_stage(str(tmp_path / "o.usda")) == []
    # In the source, a copy of the rest pose is one of many poses: nothing differs from it.
    assert [each.kind for each in check_stage(source)] == []


@pytest.mark.parametrize("bends", [BENDS, {1.0: 20.0, 2.0: 45.0}], ids=["shown", "not shown"])
def test_whether_a_frame_shows_the_rest_pose_or_not_check_finds_nothing(
    tmp_path: Path, bends: dict[float, float]
) -> None:
    """Each frame is marked in its own way, and a frame that is not bent shows the rest pose."""
    rigged = Rigged.at(tmp_path / "a.usda")
    mesh = rigged.add_tube()
    reference = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "Pref", Sdf.ValueTypeNames.Point3fArray, UsdGeom.Tokens.vertex
    )
    reference.Set(mesh.GetPointsAttr().Get())
    rigged.turn_elbow(bends)
    original = read_stage(rigged.save())
    write_flattened(original, moved(original), tmp_path / "o.usda")
    stage = Usd.Stage.Open(str(tmp_path / "o.usda"))
    points = UsdGeom.Mesh(stage.GetPrimAtPath("/man/arm")).GetPointsAttr()
    kept = np.array(stage.GetPrimAtPath("/man/arm").GetAttribute("primvars:Pref").Get())
    if bends[1.0] == 0.0:
        np.testing.assert_allclose(kept, np.array(points.Get(1.0)), atol=1e-6)
    assert 0.0 < np.abs(kept - tube()[0]).max() < 0.05
    assert points.Get() is None
    assert check_stage(str(tmp_path / "o.usda"), ["/man/arm"]) == []


def test_a_rig_that_stands_still_is_baked_without_times(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    rigged.add_tube()
    turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), 50).GetQuat()
    rigged.animation.GetRotationsAttr().Set(Vt.QuatfArray([Gf.Quatf(1), Gf.Quatf(turn)]))
    original = read_stage(rigged.save())
    marked = moved(original)
    write_override(original, marked, tmp_path / "o.usda")
    again = read_one(str(tmp_path / "o.usda"))
    assert np.isnan(again.times).all()
    np.testing.assert_array_equal(again[0].points, marked.meshes[0][0].points.astype(np.float32))


def test_flattening_keeps_a_mesh_unbound(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    rigged.add_tube(inherited=True)
    free = rigged.add_tube("/man/free").GetPrim()
    UsdSkel.BindingAPI(free).GetSkeletonRel().SetTargets([])
    rigged.turn_elbow(BENDS)
    original = read_stage(rigged.save())
    write_flattened(original, moved(original), tmp_path / "o.usda")
    assert all(mesh.notes == () for mesh in read_stage(str(tmp_path / "o.usda")).meshes)


def rest_override(original: Asset, marked: Asset, output: Path) -> None:
    write_override(original, marked, output, skel="rest", primvars="keep")


def rest_deliverable(original: Asset, marked: Asset, output: Path) -> None:
    write_flattened(original, marked, output, skel="rest", primvars="keep")


@pytest.mark.parametrize("write", [rest_override, rest_deliverable])
def test_a_marked_rest_pose_is_posed_into_the_marked_points(tmp_path: Path, write: Write) -> None:
    original = read_stage(bent_tube(tmp_path / "a.usda"))
    moves = np.random.default_rng(6).normal(0, 1e-3, tube()[0].shape)
    marked = bent_moves(original, moves)
    write(original, marked, tmp_path / "o.usda")
    again = read_one(str(tmp_path / "o.usda"))
    assert again.notes == ("rigged: posed by /man/bones",)
    for before, after in zip(marked.meshes[0], again, strict=True):
        np.testing.assert_allclose(after.points, before.points, atol=2e-6)


def test_only_the_rest_pose_changes(tmp_path: Path) -> None:
    source = bent_tube(tmp_path / "a.usda")
    original = read_stage(source)
    before = values(Usd.Stage.Open(source), list(BENDS))
    expected = {"/man/arm.points", "/man/arm.extent"}
    for primvars in ("keep", "follow"):
        output = tmp_path / f"{primvars}.usda"
        write_override(original, moved(original), output, skel="rest", primvars=primvars)
        after = values(Usd.Stage.Open(str(output)), list(BENDS))
        different = {path for path in before | after if before.get(path) != after.get(path)}
        assert different == expected
        assert after["/man/arm.points"][0] == []
        expected |= {f"/man/arm.primvars:skel:joint{each}" for each in ("Indices", "Weights")}


def test_another_animation_shows_the_mark_of_a_rest_pose(tmp_path: Path) -> None:
    original = read_stage(bent_tube(tmp_path / "a.usda"))
    moves = np.random.default_rng(6).normal(0, 1e-3, tube()[0].shape)
    rest_override(original, bent_moves(original, moves), tmp_path / "o.usda")
    stage = Usd.Stage.Open(str(tmp_path / "o.usda"))
    bend = Gf.Rotation(Gf.Vec3d(0, 0, 1), 140).GetQuat()
    rotations = stage.GetPrimAtPath("/man/walk").GetAttribute("rotations")
    rotations.Set(Vt.QuatfArray([Gf.Quatf(1), Gf.Quatf(bend)]), 8)
    stage.GetRootLayer().Save()
    mesh = read_one(str(tmp_path / "o.usda"))
    assert mesh.times.tolist() == [8]
    np.testing.assert_allclose(mesh[0].points, bent(140, moves), atol=2e-6)


def test_a_rest_pose_fits_marks_that_differ_from_frame_to_frame_as_well_as_one_can(
    tmp_path: Path,
) -> None:
    """Where joints do not bend, the pose of the rest is the mean of the marks."""
    original = read_stage(bent_tube(tmp_path / "a.usda"))
    marked = moved(original)
    rest_override(original, marked, tmp_path / "o.usda")
    rest = points_at(Usd.Stage.Open(str(tmp_path / "o.usda")), "/man/arm")
    still = elbow_weights(tube()[0]) == 0
    mean = np.mean([frame.points[still] for frame in marked.meshes[0]], axis=0)
    np.testing.assert_allclose(rest[still], mean, atol=1e-6)


def test_extents_of_poses_stay_in_sight(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    box = rigged.add_tube().CreateExtentAttr()
    for time in BENDS:
        box.Set([(-9, -9, -9), (9, 9, time)], time)
    rigged.turn_elbow(BENDS)
    original = read_stage(rigged.save())
    write_override(original, moved(original), tmp_path / "o.usda", skel="rest")
    stage = Usd.Stage.Open(str(tmp_path / "o.usda"))
    assert stage.GetAttributeAtPath("/man/arm.extent").GetTimeSamples() == list(BENDS)


def test_an_animated_rest_pose_cannot_be_marked_as_one(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    points = rigged.add_tube().GetPointsAttr()
    for time in BENDS:
        points.Set(Vt.Vec3fArray.FromNumpy((time * tube()[0]).astype(np.float32)), time)
    rigged.turn_elbow(BENDS)
    original = read_stage(rigged.save())
    with pytest.raises(UsageError, match="rest pose is animated") as caught:
        write_override(original, moved(original), tmp_path / "o.usda", skel="rest")
    assert caught.value.prim == "/man/arm"
    write_override(original, moved(original), tmp_path / "o.usda")
    assert read_one(str(tmp_path / "o.usda")).times.tolist() == list(BENDS)


@pytest.mark.parametrize("primvars", ["keep", "follow"])
def test_copies_of_poses_follow_a_marked_rest_pose(tmp_path: Path, primvars: str) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    mesh = rigged.add_tube()
    rigged.turn_elbow(BENDS)
    cache = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(
        "cache", Sdf.ValueTypeNames.Point3fArray, UsdGeom.Tokens.vertex
    )
    cache.Set(Vt.Vec3fArray.FromNumpy(bent(90).astype(np.float32)))
    original = read_stage(rigged.save())
    moves = np.random.default_rng(6).normal(0, 1e-3, tube()[0].shape)
    marked = bent_moves(original, moves)
    output = tmp_path / "o.usda"
    delivery = write_flattened(original, marked, output, skel="rest", primvars=primvars)
    assert [each.path for each in delivery.moved] == ["/man/arm.primvars:cache"]
    stage = Usd.Stage.Open(str(output))
    cached = np.array(stage.GetAttributeAtPath("/man/arm.primvars:cache").Get())
    np.testing.assert_allclose(cached, read_one(str(output))[-1].points, atol=1e-5)
    if primvars == "keep":
        np.testing.assert_allclose(cached, bent(90, moves), atol=1e-5)


def test_a_layer_with_the_animation_alone_is_part_of_the_source(tmp_path: Path) -> None:
    Rigged.at(tmp_path / "walk.usda").save()
    rigged = Rigged.at(tmp_path / "a.usda")
    rigged.add_tube()
    rigged.stage.RemovePrim("/man/walk")
    moves = rigged.stage.DefinePrim("/man/walk", "SkelAnimation")
    moves.GetReferences().AddReference("./walk.usda", "/man/walk")
    source = rigged.save()
    assert [path.name for path in stage_files(source)] == ["a.usda", "walk.usda"]
    assert tmp_path / "walk.usda" in files_in_reach(source)
    original = read_stage(source)
    with pytest.raises(OutputError):
        write_override(original, moved(original), tmp_path / "walk.usda")
