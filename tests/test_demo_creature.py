from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from meshmark.demo import creature as build
from meshmark.demo import write_creature
from meshmark.demo.flesh import creature_flesh, field
from meshmark.demo.gait import DUTY, FOOTFALL, STRIDE, joint_angles, root_shift
from meshmark.demo.nets import dual_quads, patch_table
from meshmark.demo.skeleton import creature_skeleton
from meshmark.demo.skinning import skin, skin_weights
from meshmark.demo.surface import is_closed_sphere, rest_mesh, sharpest_fold
from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.topology import edges, face_adjacency, triangulate, vertex_components

SIDES = ("left", "right")
# How far each joint may turn from rest, degrees: (backward, forward) relative to its parent.
LIMITS = {
    "scapula": (-20, 20),
    "humerus": (-25, 25),
    "radius": (-35, 45),
    "fore_cannon": (-110, 10),
    "fore_pastern": (-75, 35),
    "fore_hoof": (-30, 30),
    "femur": (-35, 45),
    "tibia": (-50, 20),
    "hind_cannon": (-25, 35),
    "hind_pastern": (-75, 35),
    "hind_hoof": (-30, 20),
    "pelvis": (-15, 15),
    "thorax": (-15, 15),
    "loin": (-10, 10),
    "neck_low": (-25, 25),
    "neck_high": (-20, 20),
    "head": (-25, 25),
    "ear": (-30, 30),
    "tail_1": (-60, 30),
    "tail_2": (-40, 30),
    "tail_3": (-40, 40),
    "tail_4": (-40, 40),
}


@pytest.fixture(scope="module")
def points(creature: MeshAnimation) -> np.ndarray:
    return np.stack([frame.points for frame in creature])


def face_vectors(P: np.ndarray, F: np.ndarray) -> np.ndarray:
    return np.cross(
        P[..., F[:, 1], :] - P[..., F[:, 0], :], P[..., F[:, 2], :] - P[..., F[:, 0], :]
    )


# Polygonisation, on shapes worked out by hand.


def grid(n: int) -> np.ndarray:
    axis = np.linspace(-1.3, 1.3, n)
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)


def test_dual_quads_of_a_sphere_lie_on_it_and_face_outward() -> None:
    n = 24
    V, Q = dual_quads(np.linalg.norm(grid(n), axis=-1) - 1.0)
    V = V * 2.6 / (n - 1) - 1.3
    F = triangulate(np.full(len(Q), 4), Q.reshape(-1))
    assert is_closed_sphere(F, len(V))
    assert np.abs(np.linalg.norm(V, axis=1) - 1.0).max() < 0.01
    volume = np.einsum("ij,ij->", V[F[:, 0]], face_vectors(V, F)) / 6
    assert volume == pytest.approx(4 / 3 * np.pi, rel=0.02)


def test_dual_quads_of_a_torus_have_its_genus() -> None:
    X = grid(32)
    ring = np.hypot(X[..., 0], X[..., 1]) - 0.8
    V, Q = dual_quads(np.hypot(ring, X[..., 2]) - 0.3)
    F = triangulate(np.full(len(Q), 4), Q.reshape(-1))
    assert len(V) - len(edges(F)) + len(F) == 0
    assert not is_closed_sphere(F, len(V))


def test_two_sheets_through_one_cell_stay_apart() -> None:
    # Two opposite corners of the middle cell are inside: one vertex a cell would join them.
    value = np.ones((4, 4, 4))
    value[1, 1, 1] = value[2, 2, 2] = -1.0
    V, Q = dual_quads(value)
    F = triangulate(np.full(len(Q), 4), Q.reshape(-1))
    assert len(V) == 16
    assert vertex_components(F, len(V)).max() == 1


def test_patches_cover_exactly_the_crossed_edges() -> None:
    table = patch_table()
    one_corner = table[1]
    assert (one_corner >= 0).sum() == 3
    assert one_corner.max() == 0
    assert np.all(table[0] == -1)
    assert np.all(table[255] == -1)
    assert np.array_equal(table >= 0, table[::-1] >= 0)
    assert table.max() == 3


def test_gradient_of_the_flesh_agrees_with_differences() -> None:
    flesh = creature_flesh()
    rng = np.random.default_rng(1)
    X = rng.uniform([-120, 5, -25], [130, 190, 25], (400, 3))
    value, slope = field(X, flesh)
    h = 1e-4
    numeric = np.stack(
        [(field(X + e, flesh)[0] - field(X - e, flesh)[0]) / (2 * h) for e in np.eye(3) * h], axis=1
    )
    near = np.abs(value) < 8
    # A few points straddle a kink, where one-sided slopes differ.
    error = np.abs(numeric - slope)[near].max(axis=1)
    assert near.sum() > 50
    assert np.mean(error < 1e-4) > 0.97


# Skinning, on motions whose result is known.


def test_a_rigid_motion_moves_the_skin_rigidly() -> None:
    skeleton, flesh = creature_skeleton(), creature_flesh()
    V, Q = rest_mesh(flesh, 7000)
    F = triangulate(np.full(len(Q), 4), Q.reshape(-1))
    W = skin_weights(V, F, skeleton, flesh)
    assert np.allclose(W.sum(axis=1), 1)
    assert W.min() >= 0
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    rotations = np.broadcast_to(R, (1, len(skeleton), 3, 3))
    translations = np.broadcast_to([3.0, -2.0, 5.0], (1, len(skeleton), 3))
    moved = skin(V, F, W, rotations, translations)[0]
    assert np.allclose(moved, V @ R.T + [3.0, -2.0, 5.0], atol=1e-9)


def test_forward_kinematics_keeps_bones_connected() -> None:
    skeleton = creature_skeleton()
    R, t = skeleton.pose(*joint_angles(skeleton, np.arange(5) / 5), np.zeros((5, 3)))
    for b, parent in enumerate(skeleton.parents):
        if parent >= 0:
            joint = skeleton.heads[b]
            own = R[:, b] @ joint + t[:, b]
            assert np.allclose(own, R[:, parent] @ joint + t[:, parent])
    assert np.allclose(R @ R.transpose(0, 1, 3, 2), np.eye(3))


# The gallop.


def test_joints_stay_within_their_limits() -> None:
    skeleton = creature_skeleton()
    pitch, yaw = np.degrees(joint_angles(skeleton, np.arange(240) / 240))
    for bone, column, sideways in zip(skeleton.bones, pitch.T, yaw.T, strict=True):
        low, high = LIMITS[bone.name.removesuffix("_left").removesuffix("_right")]
        assert low <= column.min() <= column.max() <= high, bone.name
        assert np.abs(sideways).max() <= 15, bone.name


def hooves(phase: np.ndarray) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return the way of each hoof: its toe, and the height of its lowest point, toe or heel."""
    skeleton = creature_skeleton()
    R, t = skeleton.pose(*joint_angles(skeleton, phase), root_shift(phase))
    ways = {}
    for leg in FOOTFALL:
        girdle, side = leg.split("_")
        b = skeleton.index[f"{girdle}_hoof_{side}"]
        toe = R[:, b] @ np.array(skeleton.bones[b].tail) + t[:, b]
        heel = toe - R[:, b] @ np.array([9.0, 0.0, 0.0])
        ways[leg] = toe, np.minimum(toe[:, 1], heel[:, 1])
    return ways


def test_standing_hooves_stay_on_the_ground_and_go_back_at_one_speed() -> None:
    for leg, landing in FOOTFALL.items():
        stance = np.linspace(0.01, 0.8 * DUTY, 20)
        toe, lowest = hooves(landing + stance)[leg]
        assert np.abs(lowest).max() < 4, leg
        assert np.polyfit(stance, toe[:, 0], 1)[0] == pytest.approx(-STRIDE, rel=0.1), leg


def test_a_gallop_has_one_gathered_suspension() -> None:
    phase = np.arange(96) / 96
    ways = hooves(phase)
    airborne = np.all([lowest > 4 for _, lowest in ways.values()], axis=0)
    assert 0.15 < airborne.mean() < 0.35
    starts = np.flatnonzero(airborne & ~np.roll(airborne, 1))
    assert len(starts) == 1
    middle = phase[airborne][airborne.sum() // 2]
    # Gathered: the feet are under the body, closer together than when it is stretched.
    spread = ways["fore_right"][0][:, 0] - ways["hind_left"][0][:, 0]
    assert spread[np.argmin(np.abs(phase - middle))] < 0.5 * spread.max()


# The asset.


def test_is_one_closed_surface_of_genus_zero(creature: MeshAnimation) -> None:
    frame = creature[0]
    N, F = frame.topology.n_points, frame.faces
    assert 5000 <= N <= 10000
    assert abs(N - 7000) < 350
    assert is_closed_sphere(F, N)
    assert vertex_components(F, N).max() == 0
    assert np.all(frame.topology.counts == 4)
    assert creature.constant_topology
    assert creature.prim == "/Creature/Geom/body"
    assert creature.times.tolist() == list(range(1, 25))


def test_faces_are_fairly_even_in_every_frame(creature: MeshAnimation, points: np.ndarray) -> None:
    F = creature[0].faces
    area = np.linalg.norm(face_vectors(points, F), axis=2) / 2
    assert (area / area.mean(axis=1, keepdims=True)).min() > 1e-3
    sides = np.linalg.norm(points[:, F] - points[:, np.roll(F, 1, axis=1)], axis=3)
    quality = 4 * np.sqrt(3) * area / (sides**2).sum(axis=2)
    assert np.median(quality) > 0.85
    assert np.quantile(quality, 0.01) > 0.3


def test_no_face_flips_or_folds(creature: MeshAnimation, points: np.ndarray) -> None:
    F = creature[0].faces
    n = face_vectors(points, F)
    n /= np.linalg.norm(n, axis=2, keepdims=True)
    # A hoof flicks through some 45 degrees between frames; a flip is a half turn.
    assert np.einsum("tij,tij->ti", n, np.roll(n, 1, axis=0)).min() > 0
    assert min(sharpest_fold(P, F) for P in points) > -0.6
    pairs, _ = face_adjacency(F)
    assert np.all(np.einsum("tij,tij->ti", n[:, pairs[:, 0]], n[:, pairs[:, 1]]).mean(axis=1) > 0.9)


def test_the_body_keeps_its_volume(creature: MeshAnimation, points: np.ndarray) -> None:
    F = creature[0].faces
    volume = np.einsum("tij,tij->t", points[:, F[:, 0]], face_vectors(points, F)) / 6
    assert volume.min() > 0
    assert np.ptp(volume) < 0.08 * volume.mean()


def test_the_skin_does_not_pass_through_itself(creature: MeshAnimation) -> None:
    o3d = pytest.importorskip("open3d")
    for index in (0, 11, 15, 21):
        mesh = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(creature[index].points),
            o3d.utility.Vector3iVector(creature[index].faces),
        )
        assert len(mesh.get_self_intersecting_triangles()) == 0, index


def test_shape_diameter_finds_the_same_seven_parts_in_every_pose(
    creature: MeshAnimation, points: np.ndarray
) -> None:
    # Body, neck with head, tail and four legs.
    from meshmark.extension.registry import make_segmenter

    F = creature[0].faces
    area = np.linalg.norm(face_vectors(points[0], F), axis=1)
    labels = [make_segmenter("sdf").segment(points[index], F) for index in (0, 6, 11, 17)]
    assert [label.max() + 1 for label in labels] == [7, 7, 7, 7]
    for other in labels[1:]:
        shared = np.zeros((7, 7))
        np.add.at(shared, (labels[0], other), area)
        assert len(set(shared.argmax(axis=1))) == 7
        assert shared.max(axis=1).sum() > 0.95 * area.sum()


def test_the_stride_loops(points: np.ndarray) -> None:
    step = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=2).max(axis=1)
    assert step[-1] <= step[:-1].max()
    assert step.min() > 1


def test_more_frames_are_the_same_stride(creature: MeshAnimation) -> None:
    few = build(frames=4)
    for index in range(4):
        assert np.allclose(few[index].points, creature[6 * index].points, atol=1e-9)


def test_two_builds_are_equal_to_the_byte(creature: MeshAnimation) -> None:
    again = build()
    assert again[0].topology.indices.tobytes() == creature[0].topology.indices.tobytes()
    assert all(
        a.points.tobytes() == b.points.tobytes() for a, b in zip(again, creature, strict=True)
    )


@pytest.mark.parametrize(
    "count", [10000, *(pytest.param(n, marks=pytest.mark.slow) for n in (3000, 5000, 20000))]
)
def test_other_point_counts(count: int) -> None:
    frame = build(points=count, frames=1)[0]
    assert abs(frame.topology.n_points - count) < 0.05 * count
    assert is_closed_sphere(frame.faces, frame.topology.n_points)


@pytest.mark.parametrize("wish", [{"frames": 0}, {"points": 100}, {"points": 10**6}])
def test_impossible_wishes_are_refused(wish: dict[str, int]) -> None:
    with pytest.raises(UsageError):
        build(**wish)


def test_write_creature_makes_a_stage(creature: MeshAnimation, tmp_path: Path) -> None:
    usd = pytest.importorskip("pxr.Usd")
    geom = pytest.importorskip("pxr.UsdGeom")
    path = write_creature(tmp_path / "new", frames=3)
    assert path == tmp_path / "new" / "creature.usdc"
    stage = usd.Stage.Open(str(path))
    mesh = geom.Mesh(stage.GetPrimAtPath("/Creature/Geom/body"))
    assert mesh.GetPointsAttr().GetTimeSamples() == [1.0, 2.0, 3.0]
    # The first frame of a stride is the same, however many there are.
    expected = creature[0].points.astype(np.float32)
    assert np.allclose(np.array(mesh.GetPointsAttr().Get(1.0)), expected, rtol=1e-6)


def test_write_creature_says_where_it_cannot_write(tmp_path: Path) -> None:
    blocker = tmp_path / "file"
    blocker.write_text("in the way")
    with pytest.raises(OutputError, match="file"):
        write_creature(blocker / "inside")
