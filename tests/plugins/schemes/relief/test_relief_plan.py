"""The plan: one height a vertex, low where it is thin, and no face over, in any pose."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.geometry import vertex_normals
from meshmark.metrics.faces import flipped_faces
from meshmark.testing.informed_schemes import horned
from meshmark.testing.meshes import capsule, icosphere
from meshmark_plugins.schemes.relief.height import room
from meshmark_plugins.schemes.relief.plan import POSES, ReliefPlan, plan_heights


def shrinking(frames: int) -> MeshAnimation:
    """Animate a capsule that grows thin."""
    V, F = capsule(24, 40)
    thin = np.linspace(1.0, 0.05, frames)
    return MeshAnimation.from_arrays(np.stack([V * (t, t, 1.0) for t in thin]), F)


def random_heights(animation: MeshAnimation, scale: float, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0.0, scale, len(animation[0].points))


def test_what_is_low_enough_stays_as_it_is() -> None:
    f = random_heights(horned(), 1e-4)
    np.testing.assert_allclose(plan_heights(horned(), f), f, rtol=1e-12)


def test_no_height_takes_more_than_its_share_of_the_thickness_in_any_pose() -> None:
    animation = shrinking(5)
    f = random_heights(animation, 0.02)
    lowered = plan_heights(animation, f)
    for frame in animation:
        assert (np.abs(lowered) <= room(frame.points, frame.faces) * (1 + 1e-9)).all()
    assert (np.abs(lowered) <= np.abs(f)).all()
    assert (lowered * f >= 0.0).all()
    # It was too high before, and is not gone now.
    assert np.abs(f).max() > np.abs(lowered).max() > 0.0


def test_heights_of_nothing_are_nothing() -> None:
    np.testing.assert_array_equal(plan_heights(horned(), np.zeros(len(horned()[0].points))), 0.0)


@settings(max_examples=10)
@given(st.integers(0, 10**6), st.floats(-4.0, 0.0))
def test_no_face_turns_over_however_high_the_relief(seed: int, log_height: float) -> None:
    animation = horned()
    f = plan_heights(animation, random_heights(animation, 10.0**log_height, seed))
    plan = ReliefPlan(f, 1)
    for index, frame in enumerate(animation):
        moved = plan.mark(index, frame)
        assert np.isfinite(moved).all()
        assert flipped_faces(frame.points, moved, frame.faces) == 0


def test_poses_that_were_not_looked_at_do_not_flip_either() -> None:
    V, F = icosphere(3)
    flat = [V * (1.0, 1.0, 0.02 if t == 1 else 1.0) for t in range(3 * POSES)]
    animation = MeshAnimation.from_arrays(np.stack(flat), F)
    plan = ReliefPlan(plan_heights(animation, random_heights(animation, 0.05)), 1)
    moved = plan.mark(1, animation[1])
    assert flipped_faces(animation[1].points, moved, F) == 0


@pytest.mark.parametrize("index", [0, 2])
def test_a_mark_is_a_height_along_the_frames_own_normals(index) -> None:
    frame = horned()[index]
    f = random_heights(horned(), 1e-4)
    moved = ReliefPlan(f, 1).mark(index, frame)
    expected = f[:, None] * vertex_normals(frame.points, frame.faces)
    np.testing.assert_allclose(moved - frame.points, expected, atol=1e-12)
