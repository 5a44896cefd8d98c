from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from creature.surface import is_closed_sphere, sharpest_fold
from make_creature import model
from meshmark.demo import creature as build
from meshmark.demo import write_creature
from meshmark.demo.build import DATA, FRAMES, POINTS
from meshmark.demo.skinning import skin, skin_weights
from meshmark.errors import OutputError, UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.topology import face_adjacency, vertex_components
from meshmark.testing.meshes import icosphere


@pytest.fixture(scope="module")
def points(creature: MeshAnimation) -> np.ndarray:
    return np.stack([frame.points for frame in creature])


def face_vectors(P: np.ndarray, F: np.ndarray) -> np.ndarray:
    return np.cross(
        P[..., F[:, 1], :] - P[..., F[:, 0], :], P[..., F[:, 2], :] - P[..., F[:, 0], :]
    )


# Skinning, on a motion whose result is known.


def test_a_rigid_motion_moves_the_skin_rigidly() -> None:
    V, F = icosphere(3)
    W = skin_weights(np.random.default_rng(1).random((len(V), 4)), F)
    assert np.allclose(W.sum(axis=1), 1)
    assert W.min() >= 0
    turn, shift = Rotation.from_rotvec([0.3, 0.5, 0.7]), np.array([3.0, -2.0, 5.0])
    # The dual part of a unit dual quaternion: half its translation times its real part.
    real = turn.as_quat()
    dual = [*(real[3] * shift + np.cross(shift, real[:3])) / 2, -shift @ real[:3] / 2]
    moved = skin(V, F, W, np.broadcast_to([*real, *dual], (1, 4, 8)))[0]
    assert np.allclose(moved, turn.apply(V) + shift, atol=1e-9)


# The gallop.


def test_a_gallop_has_one_suspension(points: np.ndarray) -> None:
    lowest = points[..., 1].min(axis=1)
    assert lowest.min() > -4
    airborne = lowest > 4
    assert 0.15 < airborne.mean() < 0.35
    assert np.sum(airborne & ~np.roll(airborne, 1)) == 1


def test_what_stands_on_the_ground_goes_back_at_one_speed(points: np.ndarray) -> None:
    following = np.roll(points, -1, axis=0)
    standing = (points[..., 1] < 2) & (following[..., 1] < 2)
    speed = len(points) * (following - points)[standing, 0]
    assert np.median(speed) == pytest.approx(-440, rel=0.05)
    assert np.quantile(np.abs(speed / 440 + 1), 0.9) < 0.1


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


@pytest.mark.parametrize("points", POINTS)
@pytest.mark.parametrize("frames", FRAMES)
def test_every_size_and_stride_on_offer_is_there(points: int, frames: int) -> None:
    animation = build(points, frames)
    assert len(animation) == frames
    assert abs(animation[0].topology.n_points - points) < 0.05 * points
    assert is_closed_sphere(animation[0].faces, animation[0].topology.n_points)


@pytest.mark.parametrize("wish", [{"frames": 0}, {"frames": 5}, {"points": 4000}])
def test_what_is_not_on_offer_is_refused(wish: dict[str, int]) -> None:
    with pytest.raises(UsageError, match=r"points is one of 3000, 7000;|frames is one of 1, 2, 3,"):
        build(**wish)


@pytest.mark.slow
def test_the_model_makes_the_shipped_data_again() -> None:
    made = model()
    with np.load(DATA, allow_pickle=False) as shipped:
        assert sorted(shipped) == sorted(made)
        for name, array in made.items():
            assert array.dtype == shipped[name].dtype, name
            # Other versions of numpy and scipy may round otherwise.
            tolerance = 1e-6 if array.dtype == np.float64 else 0
            assert np.allclose(array, shipped[name], rtol=0, atol=tolerance), name


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
