"""Frames that are blends of their neighbours, and those that are poses of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.detection.interpolated_frames import own_poses
from meshmark.extension.registry import make_attack
from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.meshes import icosphere

FRAMES = 17


def swinging(n_frames=FRAMES, times=None) -> MeshAnimation:
    """A ball that goes round a point, as limbs do."""
    V, F = icosphere(2)
    angle = 0.2 * np.arange(n_frames)
    cos, sin = np.cos(angle), np.sin(angle)
    turns = np.zeros((n_frames, 3, 3))
    turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1] = cos, -sin, sin, cos
    turns[:, 2, 2] = 1.0
    X = (V + np.array([3.0, 0.0, 0.0])) @ turns.transpose(0, 2, 1)
    return MeshAnimation.from_arrays(X, F, times=times)


def in_float32(animation) -> MeshAnimation:
    points = np.array([frame.points for frame in animation]).astype(np.float32)
    return MeshAnimation.from_arrays(
        points.astype(np.float64), animation[0].faces, times=animation.times
    )


def test_all_poses_of_a_real_motion_are_its_own() -> None:
    animation = in_float32(swinging())
    assert own_poses(animation, range(FRAMES)) == list(range(FRAMES))


@pytest.mark.parametrize("keep", [2, 4, 8])
def test_resampling_leaves_the_poses_it_kept(keep) -> None:
    attack = make_attack("resample", factor=keep)
    animation = in_float32(attack.apply(swinging(), np.random.default_rng(0)))
    assert own_poses(animation, range(FRAMES)) == list(range(0, FRAMES, keep))
    assert own_poses(animation, [0, 1, keep]) == [0, keep]


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1))
def test_blends_at_uneven_times_are_told_by_their_times(seed) -> None:
    rng = np.random.default_rng(seed)
    times = np.cumsum(rng.uniform(0.2, 2.0, FRAMES))
    keys = np.unique(np.concatenate([[0, FRAMES - 1], rng.choice(FRAMES, 6)]))
    poses = np.array([frame.points for frame in swinging()])
    place = np.interp(times, times[keys], np.arange(len(keys)))
    before = np.minimum(place.astype(int), len(keys) - 2)
    share = (place - before)[:, None, None]
    X = (1.0 - share) * poses[keys[before]] + share * poses[keys[before + 1]]
    animation = MeshAnimation.from_arrays(X, swinging()[0].faces, times=times)
    assert own_poses(in_float32(animation), range(FRAMES)) == keys.tolist()


def test_a_mesh_at_rest_keeps_all_of_its_frames() -> None:
    V, F = icosphere(2)
    still = MeshAnimation.from_arrays(np.tile(V, (5, 1, 1)), F)
    assert own_poses(still, range(5)) == list(range(5))


def test_noise_makes_a_frame_its_own() -> None:
    resampled = make_attack("resample", factor=4).apply(swinging(), np.random.default_rng(0))
    noisy = make_attack("noise", amplitude=0.005).apply(resampled, np.random.default_rng(0))
    assert own_poses(noisy, range(FRAMES)) == list(range(FRAMES))


def test_where_only_blends_are_asked_for_they_are_what_there_is() -> None:
    resampled = make_attack("resample", factor=4).apply(swinging(), np.random.default_rng(0))
    assert own_poses(resampled, [1, 2]) == [1, 2]


def test_frames_of_their_own_connectivity_are_never_blends() -> None:
    resampled = make_attack("resample", factor=4).apply(swinging(), np.random.default_rng(0))
    frames = [
        replace(
            frame, topology=replace(frame.topology, indices=np.roll(frame.topology.indices, 3 * t))
        )
        for t, frame in enumerate(resampled)
    ]
    changing = MeshAnimation.from_frames(frames)
    assert own_poses(changing, range(FRAMES)) == list(range(FRAMES))
