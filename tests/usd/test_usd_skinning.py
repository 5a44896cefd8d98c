"""Rigged meshes are read as their rigs pose them: by hand, beside baselines of USD, broken."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt

from meshmark.errors import InputError
from meshmark.mesh.animation import MeshAnimation
from meshmark.usd.reading import read_stage
from meshmark.usd.writing import write_override
from rigged_stages import BENDS, Rigged, bent, bent_tube, elbow_weights, rotation, tube, twisted
from usd_stages import read_one

CLOSE = 1e-6
POSED = ("rigged: posed by /man/bones",)


def at(mesh: MeshAnimation, time: float) -> np.ndarray:
    return mesh[mesh.times.tolist().index(time)].points


@pytest.mark.parametrize("inherited", [False, True])
def test_bones_bend_a_tube(tmp_path: Path, inherited: bool) -> None:
    mesh = read_one(bent_tube(tmp_path / "a.usda", inherited=inherited))
    assert mesh.times.tolist() == list(BENDS)
    assert mesh.notes == POSED
    for time, degrees in BENDS.items():
        np.testing.assert_allclose(at(mesh, time), bent(degrees), atol=CLOSE)


def test_frames_pickle_small_and_are_read_when_asked_for(tmp_path: Path) -> None:
    mesh = read_one(bent_tube(tmp_path / "a.usda"))
    frames = pickle.dumps(mesh.source)
    assert len(frames) < 1000
    np.testing.assert_allclose(pickle.loads(frames).frame(2).points, bent(90), atol=CLOSE)
    assert mesh[0].topology is mesh[2].topology


def test_dual_quaternions_twist_it_without_thinning(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    binding = UsdSkel.BindingAPI(rigged.add_tube().GetPrim())
    binding.CreateSkinningMethodAttr(UsdSkel.Tokens.dualQuaternion)
    rigged.turn_elbow({1: 0, 2: 150}, axis=(1, 0, 0))
    points = at(read_one(rigged.save()), 2)
    np.testing.assert_allclose(points, twisted(150), atol=CLOSE)
    np.testing.assert_allclose(np.hypot(*points[:, 1:].T), 0.2, atol=CLOSE)


def test_a_mesh_knows_which_joints_move_it(tmp_path: Path) -> None:
    found = read_one(bent_tube(tmp_path / "a.usda")).skinning
    assert found is not None
    w = elbow_weights(tube()[0])
    np.testing.assert_allclose(found.rest, tube()[0], atol=CLOSE)
    np.testing.assert_array_equal(found.joints, [[0, 1]] * len(w))
    np.testing.assert_allclose(found.weights, np.stack([1 - w, w], axis=1))


def test_rest_points_that_move_and_rigid_meshes_tell_of_no_joints(tmp_path: Path) -> None:
    moving = Rigged.at(tmp_path / "a.usda")
    moving.add_tube().GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(tube()[0].astype("f4")), 2.0)
    assert read_one(moving.save()).skinning is None
    rigid = Rigged.at(tmp_path / "b.usda")
    binding = UsdSkel.BindingAPI(rigid.add_tube().GetPrim())
    binding.CreateJointIndicesPrimvar(True, 1).Set([1])
    binding.CreateJointWeightsPrimvar(True, 1).Set([1.0])
    assert read_one(rigid.save()).skinning is None


def test_blend_shapes_pass_their_in_between_and_are_bent_then(tmp_path: Path) -> None:
    half, whole = np.random.default_rng(3).normal(0, 0.05, (2, len(tube()[0]), 3))
    rigged = Rigged.at(tmp_path / "a.usda")
    rigged.add_shape(rigged.add_tube(), whole, half, {1: 0.25, 2: 0.5, 3: 0.75, 6: 1})
    rigged.turn_elbow({1: 0, 5: 80})
    mesh = read_one(rigged.save())
    assert mesh.times.tolist() == [1, 2, 3, 5, 6]
    # At 5, between samples, the weight is 11/12: of the way from one half to one, 5/6.
    expected = {
        1: bent(0, half / 2),
        2: bent(20, half),
        3: bent(40, (half + whole) / 2),
        5: bent(80, half / 6 + whole * 5 / 6),
        6: bent(80, whole),
    }
    for time, points in expected.items():
        np.testing.assert_allclose(at(mesh, time), points, atol=CLOSE)


def test_blend_shapes_alone_need_no_joints(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    mesh = rigged.add_tube()
    for name in ("jointIndices", "jointWeights"):
        mesh.GetPrim().RemoveProperty(f"primvars:skel:{name}")
    UsdGeom.XformCommonAPI(mesh).SetTranslate((5, 0, 0))
    offsets = np.full_like(tube()[0], 0.25)
    rigged.add_shape(mesh, offsets, offsets / 4, {1: 0, 2: 0.5, 3: 1})
    found = read_one(rigged.save())
    for time, share in {1: 0, 2: 0.25, 3: 1}.items():
        expected = tube()[0] + [5, 0, 0] + share * offsets
        np.testing.assert_allclose(at(found, time), expected, atol=CLOSE)


def test_one_joint_carries_a_rigid_mesh(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    binding = UsdSkel.BindingAPI(rigged.add_tube().GetPrim())
    binding.SetRigidJointInfluence(1)
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d().SetTranslate((0, 0, 2)))
    rigged.turn_elbow({1: 40})
    elbow = np.array([1, 0, 0])
    expected = (tube()[0] + [0, 0, 2] - elbow) @ rotation((0, 0, 1), 40) + elbow
    np.testing.assert_allclose(at(read_one(rigged.save()), 1), expected, atol=CLOSE)


def test_the_skeleton_carries_it_not_the_prim_s_own_transform(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    mesh = rigged.add_tube()
    rigged.turn_elbow(BENDS)
    UsdGeom.XformCommonAPI(mesh).SetTranslate((7, 8, 9), 3.0)
    UsdGeom.XformCommonAPI(mesh).SetScale((2, 3, 4))
    bones = UsdGeom.XformCommonAPI(rigged.stage.GetPrimAtPath("/man/bones"))
    for time in (2.5, 4.0):
        bones.SetTranslate((0, 0, time), time)
    found = read_one(rigged.save())
    # Whatever moves is sampled: joints, prim, skeleton.
    assert found.times.tolist() == [1, 2, 2.5, 3, 4]
    for time, degrees, height in ((1, 0, 2.5), (2.5, 45, 2.5), (3, 60, 3), (4, 90, 4)):
        np.testing.assert_allclose(
            at(found, time), bent(degrees) + np.array([0, 0, height]), atol=1e-5
        )


def test_several_meshes_and_those_that_are_not_bound(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    for name in ("left", "right"):
        rigged.add_tube(f"/man/{name}")
    free = rigged.add_tube("/man/free").GetPrim()
    UsdSkel.BindingAPI(free).GetSkeletonRel().SetTargets([])
    outside = rigged.add_tube("/outside")
    rigged.turn_elbow(BENDS)
    meshes = {mesh.prim: mesh for mesh in read_stage(rigged.save()).meshes}
    for path in ("/man/left", "/man/right"):
        np.testing.assert_allclose(at(meshes[path], 4), bent(90), atol=CLOSE)
    for path in (str(free.GetPath()), str(outside.GetPath())):
        assert np.isnan(meshes[path].times).all()
        assert meshes[path].notes == ()
        np.testing.assert_allclose(meshes[path][0].points, tube()[0], atol=CLOSE)


def test_a_rig_that_stands_still_has_no_times(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    rigged.add_tube()
    turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), 50).GetQuat()
    rigged.animation.GetRotationsAttr().Set(Vt.QuatfArray([Gf.Quatf(1), Gf.Quatf(turn)]))
    mesh = read_one(rigged.save())
    assert np.isnan(mesh.times).all()
    np.testing.assert_allclose(mesh[0].points, bent(50), atol=CLOSE)


def test_references_shift_and_stretch_time(tmp_path: Path) -> None:
    bent_tube(tmp_path / "a.usda")
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    man = stage.DefinePrim("/crowd/man")
    man.GetReferences().AddReference("./a.usda", Sdf.LayerOffset(10, 0.5))
    stage.GetRootLayer().Save()
    mesh = read_one(str(tmp_path / "shot.usda"))
    assert mesh.times.tolist() == [10.5, 11, 12]
    for time, degrees in ((10.5, 0), (11, 30), (12, 90)):
        np.testing.assert_allclose(at(mesh, time), bent(degrees), atol=CLOSE)


def test_every_instance_is_posed_where_it_stands(tmp_path: Path) -> None:
    bent_tube(tmp_path / "a.usda")
    stage = Usd.Stage.CreateNew(str(tmp_path / "crowd.usda"))
    for n in (1, 2):
        man = UsdGeom.Xform.Define(stage, f"/crowd/man{n}")
        body = stage.DefinePrim(man.GetPath().AppendChild("body"))
        body.GetReferences().AddReference("./a.usda")
        body.SetInstanceable(True)
        UsdGeom.XformCommonAPI(man).SetTranslate((0, n, 0))
    stage.GetRootLayer().Save()
    for n, mesh in enumerate(read_stage(str(tmp_path / "crowd.usda")).meshes, start=1):
        assert mesh.prim == f"/crowd/man{n}/body/arm"
        np.testing.assert_allclose(at(mesh, 4), bent(90) + np.array([0, n, 0]), atol=CLOSE)


def joints_of_one(rigged: Rigged) -> None:
    rigged.stage.GetPrimAtPath("/man/bones").GetAttribute("bindTransforms").Set([Gf.Matrix4d(1)])


def no_skeleton(rigged: Rigged) -> None:
    rigged.stage.RemovePrim("/man/bones")


N = len(tube()[0])
BROKEN: dict[str, dict[str, list[int] | list[float]]] = {
    "joint out of range": {"jointIndices": [0, 7] * N},
    "negative joint": {"jointIndices": [0, -7] * N},
    "too few weights": {"jointWeights": [1.0]},
    "too few of both": {"jointIndices": [0, 1], "jointWeights": [1.0, 0.0]},
}


@pytest.mark.parametrize("case", BROKEN)
def test_what_a_rig_cannot_pose_is_read_at_rest(tmp_path: Path, case: str) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    arm = rigged.add_tube()
    rigged.turn_elbow(BENDS)
    for name, value in BROKEN[case].items():
        arm.GetPrim().GetAttribute(f"primvars:skel:{name}").Set(value)
    mesh = read_one(rigged.save())
    (note,) = mesh.notes
    assert note.startswith("rigged, and read in its rest pose: ")
    assert "\n" not in note
    np.testing.assert_allclose(mesh[0].points, tube()[0], atol=CLOSE)


@pytest.mark.parametrize("breaking", [joints_of_one, no_skeleton])
def test_a_skeleton_that_is_broken_or_missing_stops_nothing(
    tmp_path: Path, breaking: Callable[[Rigged], None]
) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    rigged.add_tube()
    rigged.turn_elbow(BENDS)
    breaking(rigged)
    mesh = read_one(rigged.save())
    assert np.isfinite(mesh[0].points).all()


def test_weights_that_are_no_numbers_leave_a_mesh_out(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    rigged.add_tube("/man/leg")
    arm = rigged.add_tube().GetPrim()
    arm.GetAttribute("primvars:skel:jointWeights").Set([np.nan] * (2 * len(tube()[0])))
    rigged.turn_elbow(BENDS)
    asset = read_stage(rigged.save())
    assert [mesh.prim for mesh in asset.meshes] == ["/man/leg"]
    assert [each.prim for each in asset.left_out] == ["/man/arm"]
    assert "finite" in asset.left_out[0].reason


def test_a_frame_whose_joints_are_no_numbers_is_a_bad_frame(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    rigged.add_tube()
    rigged.turn_elbow(BENDS)
    bad = Vt.QuatfArray([Gf.Quatf(1), Gf.Quatf(np.nan)])
    rigged.animation.GetRotationsAttr().Set(bad, 3.0)
    mesh = read_one(rigged.save())
    np.testing.assert_allclose(at(mesh, 4), bent(90), atol=CLOSE)
    with pytest.raises(InputError, match="finite") as caught:
        at(mesh, 3)
    assert caught.value.prim == "/man/arm"
    assert caught.value.time == 3


def test_a_shape_that_does_not_fit_is_not_blended(tmp_path: Path) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    arm = rigged.add_tube()
    rigged.turn_elbow(BENDS)
    offsets = np.ones((2, 3))
    rigged.add_shape(arm, offsets, offsets, {1: 1, 4: 1})
    shape = UsdSkel.BlendShape(rigged.stage.GetPrimAtPath("/man/arm/smile"))
    shape.CreatePointIndicesAttr([0, 10_000])
    np.testing.assert_allclose(at(read_one(rigged.save()), 4), bent(90), atol=CLOSE)


@pytest.mark.parametrize("prim", ["/man/arm", "/man"])
def test_what_is_scaled_to_nothing_for_a_while_keeps_its_rig(tmp_path: Path, prim: str) -> None:
    rigged = Rigged.at(tmp_path / "a.usda")
    rigged.add_tube()
    rigged.turn_elbow(BENDS)
    for time, scale in ((1.0, 0.0), (2.0, 1.0)):
        place = UsdGeom.XformCommonAPI(rigged.stage.GetPrimAtPath(prim))
        place.SetScale(Gf.Vec3f(scale), time)
    original = read_stage(rigged.save())
    (mesh,) = original.meshes
    assert mesh.notes == POSED
    for time, points in ((1, 0 * bent(0)), (4, bent(90))):
        np.testing.assert_allclose(at(mesh, time), points, atol=CLOSE)
    for skel in ("bake", "rest"):
        output = tmp_path / f"{skel}.usda"
        write_override(original, original, output, skel=skel)
        np.testing.assert_allclose(at(read_one(str(output)), 4), bent(90), atol=CLOSE)


@pytest.mark.parametrize(
    ("name", "baseline"),
    [
        ("lbs", "lbs.baked"),
        ("lbs", "lbs.bakedInterval"),
        ("dqs", "dqs.baked"),
        ("dqs", "dqs.bakedInterval"),
        ("blendshapes", "blendshapes.baked"),
    ],
)
def test_baselines(data_folder: Path, name: str, baseline: str) -> None:
    folder = data_folder / "usd" / "skel-baking"
    stage = Usd.Stage.Open(str(folder / "baseline" / f"{baseline}.usda"))
    asset = read_stage(str(folder / f"{name}.usda"))
    assert any(mesh.notes for mesh in asset.meshes)
    for mesh in asset.meshes:
        points = UsdGeom.Mesh(stage.GetPrimAtPath(mesh.prim)).GetPointsAttr()
        times = points.GetTimeSamples()
        assert set(times) <= set(mesh.times.tolist())
        for time in times:
            baked = np.array(points.Get(time))
            size = np.ptp(baked, axis=0).max()
            np.testing.assert_allclose(at(mesh, time), baked, rtol=0, atol=1e-5 * size)
