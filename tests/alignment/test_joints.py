"""An original that knows its joints is moved by them to poses that it never takes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from alignment_shapes import mapped, similarity
from meshmark.alignment.align import align_mesh
from meshmark.alignment.joints import moved_by_joints
from meshmark.alignment.reposing import reposed
from meshmark.arrays import FloatArray
from meshmark.detection.informed import gather_informed
from meshmark.detection.significance import judge
from meshmark.embedding.asset import embed
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.mesh.geometry import surface_box, vertex_normals
from meshmark.mesh.skinning import Skinning
from meshmark.mesh.topology import Topology
from meshmark.sources.reading import read
from meshmark.sources.writing import writer
from meshmark.testing.meshes import bent_tube

KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))
RELIEF = [Recipe("relief")]
LENGTH, JOINTS = 4.0, 4
REST, F = bent_tube(16, 60, angle=0.0)
TOPOLOGY = Topology.from_triangles(F, len(REST))


def weights_along(z: FloatArray) -> FloatArray:
    """Return the weights (N, JOINTS) of joints at equal distances, which blend smoothly."""
    at = np.linspace(0.0, LENGTH, JOINTS)
    near = np.exp(-(((z[:, None] - at) / 0.5) ** 2))
    return near / near.sum(axis=1, keepdims=True)


SKIN = Skinning(REST, np.tile(np.arange(JOINTS), (len(REST), 1)), weights_along(REST[:, 2]))


def pose(seed: int, degrees: float) -> FloatArray:
    """Draw maps of the joints, (JOINTS, 3, 4): each turns by about so much from the one below."""
    rng = np.random.default_rng(seed)
    maps, R, origin = [], np.eye(3), np.zeros(3)
    for k in range(JOINTS):
        if k:
            origin = origin + R @ [0.0, 0.0, LENGTH / (JOINTS - 1)]
            axis = rng.normal(size=3)
            turn = np.radians(degrees) * axis / np.linalg.norm(axis)
            R = R @ Rotation.from_rotvec(turn).as_matrix()
        here = np.array([0.0, 0.0, k * LENGTH / (JOINTS - 1)])
        maps.append(np.column_stack([R, origin - R @ here]))
    return np.stack(maps)


def skinned(maps: FloatArray, P: FloatArray, skin: Skinning = SKIN) -> FloatArray:
    """Skin points linearly."""
    blended = np.einsum("nk,nkij->nij", skin.weights, maps[skin.joints])
    return np.einsum("nij,nj->ni", blended[:, :, :3], P) + blended[:, :, 3]


POSES = pose(0, 10.0), pose(1, 50.0)


@pytest.mark.parametrize("seed", range(3))
def test_joints_take_a_surface_to_any_pose(seed: int) -> None:
    V, Q = skinned(POSES[0], REST), skinned(pose(seed, 50.0), REST)
    np.testing.assert_allclose(moved_by_joints(SKIN, V, Q), Q, atol=1e-6)


def test_what_stands_out_of_the_rest_pose_is_left() -> None:
    V, Q = (skinned(maps, REST) for maps in POSES)
    height = 1e-4 * np.random.default_rng(0).choice((-1.0, 1.0), len(REST))
    marked = skinned(POSES[1], REST + height[:, None] * vertex_normals(REST, F))
    kept = []
    for bent in (moved_by_joints(SKIN, V, marked), reposed(V, marked, TOPOLOGY)):
        left = ((marked - bent) * vertex_normals(Q, F)).sum(axis=1)
        kept.append(np.corrcoef(left, height)[0, 1])
    # The joints adapt by 12 numbers each, the neighbourhoods by as many at every vertex.
    assert kept[0] > 0.98
    assert kept[1] < 0.7


def test_what_the_joints_do_not_explain_hangs_on_them() -> None:
    more = 0.05 * np.sin(REST[:, [2, 0, 1]])
    V, Q = (skinned(maps, REST + more) for maps in POSES)
    # To the first order in it: 2 % of 0.05.
    np.testing.assert_allclose(moved_by_joints(SKIN, V, Q), Q, atol=1e-3)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 99))
def test_order_and_similarity_do_not_matter(seed: int) -> None:
    V, Q = (skinned(maps, REST) for maps in POSES)
    Q = Q + 1e-3 * np.random.default_rng(seed).normal(size=Q.shape)
    expected = moved_by_joints(SKIN, V, Q)
    order = np.random.default_rng(seed).permutation(len(V))
    np.testing.assert_allclose(
        moved_by_joints(SKIN.of(order), V[order], Q[order]), expected[order], atol=1e-6
    )
    A, B = similarity(seed), similarity(seed + 1, mirror=True)
    scale = np.cbrt(abs(np.linalg.det(B[:, :3])))
    found = moved_by_joints(SKIN, mapped(A, V), mapped(B, Q))
    np.testing.assert_allclose(found, mapped(B, expected), atol=1e-6 * scale)


def test_joints_of_nothing_and_of_little() -> None:
    Q = skinned(POSES[1], REST)
    nothing = Skinning(REST, SKIN.joints, 0.0 * SKIN.weights)
    alone = Skinning(REST, np.where(np.arange(len(REST)) == 5, 1, 0)[:, None], np.ones((len(Q), 1)))
    for skin in (nothing, alone):
        assert np.isfinite(moved_by_joints(skin, REST, Q)).all()
    assert np.linalg.norm((moved_by_joints(alone, REST, Q) - Q)[5]) < 1e-6


@dataclass(frozen=True)
class Posed:
    """The tube, skinned to poses."""

    poses: tuple[FloatArray, ...]
    rest: FloatArray

    def frame(self, index: int) -> Frame:
        return Frame(index + 1.0, skinned(self.poses[index], self.rest), TOPOLOGY)

    def skinning(self) -> Skinning:
        return Skinning(self.rest, SKIN.joints, SKIN.weights)


def animated(*poses: FloatArray, rest: FloatArray = REST) -> MeshAnimation:
    return MeshAnimation(np.arange(1.0, len(poses) + 1), Posed(poses, rest), prim="/Tube")


def test_a_pose_that_bends_edges_is_placed() -> None:
    copy = animated(pose(2, 70.0), pose(3, 70.0)).map(lambda frame: frame)
    found = align_mesh(copy, animated(*POSES), range(2))
    assert found.method == "reposed"
    assert len(found.frames) == 2
    assert found.residual < 1e-6


@pytest.mark.parametrize("mirror", [False, True])
def test_only_a_mirror_image_is_placed_as_one(mirror: bool) -> None:
    A = similarity(3, mirror=mirror)
    for seed in range(20):
        copy = animated(pose(seed, 100.0)).map(lambda frame: frame.moved(mapped(A, frame.points)))
        placed = align_mesh(copy, animated(*POSES), [0]).frames[0].maps["similarity"]
        assert (np.linalg.det(placed.matrix[:, :3]) < 0.0) == mirror


def test_a_pose_near_to_one_of_the_original_is_told_from_it() -> None:
    original = animated(*POSES)
    near = [pose(0, 12.0), *POSES]
    methods = [align_mesh(animated(each), original, [0]).method for each in near]
    assert methods == ["reposed", "identity", "identity"]


@pytest.mark.slow
def test_relief_is_read_in_any_pose_and_nothing_where_there_is_none() -> None:
    original = animated(*POSES)
    marked = embed(original, KEY, recipe=RELIEF).asset.meshes[0]
    # The rest pose that shows the mark in the first pose.
    blended = np.einsum("nk,nkij->nij", SKIN.weights, POSES[0][SKIN.joints])[:, :, :3]
    move = marked[0].points - original[0].points
    rest = REST + np.einsum("nij,nj->ni", np.linalg.inv(blended), move)
    new = [pose(seed, 70.0) for seed in (5, 6, 7)]
    diagonal = surface_box(REST, F)[0]
    rng = np.random.default_rng(0)

    def noisy(frame: Frame) -> Frame:
        return frame.moved(frame.points + 5e-5 * diagonal * rng.normal(size=frame.points.shape))

    leak = animated(*new, rest=rest).map(noisy)
    [found] = gather_informed(as_asset(leak), as_asset(original), RELIEF).items
    assert found.informed is not None
    assert found.informed.method == "reposed"
    assert judge(found, KEY).log10_p < -10
    [nothing] = gather_informed(
        as_asset(animated(*new).map(noisy)), as_asset(original), RELIEF
    ).items
    keys = [Key(rng.bytes(32)) for _ in range(200)]
    for evidence, tried in ((found, keys), (nothing, [KEY, *keys])):
        log10_p = np.array([judge(evidence, key).log10_p for key in tried])
        for share in (0.1, 0.02):
            assert (log10_p <= np.log10(share)).mean() <= share + 3 * np.sqrt(share / len(tried))


@pytest.mark.slow
@pytest.mark.parametrize("clip", ["Walk", "Run"])
def test_a_real_rig_is_found_in_its_other_clips(
    data_folder: Path, tmp_path: Path, clip: str
) -> None:
    original = read(data_folder / "gltf" / "Fox.glb")
    writer(original, tmp_path / "leak.glb")(embed(original, KEY).asset)
    leak = read(tmp_path / "leak.glb", parameters={"clip": clip})
    [found] = gather_informed(leak, original, RELIEF).items
    assert found.informed is not None
    assert found.informed.method == "reposed"
    assert judge(found, KEY).log10_p < -10
    assert judge(found, OTHER).log10_p > -3
    unmarked = read(original.source, parameters={"clip": clip})
    [nothing] = gather_informed(unmarked, original, RELIEF).items
    assert judge(nothing, KEY).log10_p > -3
