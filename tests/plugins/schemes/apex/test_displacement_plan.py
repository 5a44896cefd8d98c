"""Keyframes, and the displacements that are planned and blended from them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshmark.demo import creature as build_creature
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import area_vectors
from meshmark.metrics.surface_distance import mrms, surface_distance
from meshmark.workers.scratch import DOUBLE, ScratchFile
from meshmark_plugins.schemes.apex.anchors.track import FrameAnchors, lasting_anchors
from meshmark_plugins.schemes.apex.marking.displacement_transfer import DisplacementTransfer
from meshmark_plugins.schemes.apex.marking.plan import (
    MAX_POSES_PER_KEYFRAME,
    SurfacePlan,
    limit_mrms,
    poses_of_keyframe,
    spread_keyframes,
)
from meshmark_plugins.schemes.apex.scheme import Apex

WORDS = np.array(Key(bytes(range(32))).words("apex", Apex().n_words, Apex().n_chips))


def test_fewer_frames_than_hold_have_one_keyframe():
    assert spread_keyframes(1, 8).tolist() == spread_keyframes(8, 8).tolist() == [0.0]
    assert spread_keyframes(9, 8).tolist() == [0.0, 8.0]
    assert spread_keyframes(16, 8).tolist() == [0.0, 15.0]
    assert spread_keyframes(17, 8).tolist() == [0.0, 8.0, 16.0]
    assert spread_keyframes(3, 1).tolist() == [0.0, 1.0, 2.0]


@given(st.integers(1, 2000), st.integers(1, 100))
def test_keyframes_span_the_animation_at_least_hold_frames_apart(n_frames, hold):
    keyframes = spread_keyframes(n_frames, hold)
    assert keyframes[0] == 0.0
    if len(keyframes) > 1:
        assert keyframes[-1] == n_frames - 1
        # Never sooner: a mark that changes faster than it may would be seen.
        assert hold <= np.diff(keyframes).min() <= np.diff(keyframes).max() < 2 * hold
    else:
        assert n_frames - 1 < hold


@given(st.integers(1, 500), st.integers(1, 60))
def test_a_keyframe_serves_the_frames_up_to_its_neighbours(n_frames, hold):
    keyframes = spread_keyframes(n_frames, hold)
    for j in range(len(keyframes)):
        poses = poses_of_keyframe(keyframes, j, n_frames)
        assert len(poses) <= MAX_POSES_PER_KEYFRAME
        assert poses == sorted(set(poses))
        low = keyframes[max(j - 1, 0)]
        high = keyframes[j + 1] if j + 1 < len(keyframes) else n_frames - 1
        assert (poses[0], poses[-1]) == (round(low), round(high))


def kept(d) -> ScratchFile:
    scratch = ScratchFile.create(len(d), d.shape[1] // 3, DOUBLE)
    for j, displacement in enumerate(d):
        scratch.write(j, displacement)
    return scratch


def test_frames_between_keyframes_blend_theirs():
    d = np.random.default_rng(0).normal(size=(3, 12))
    transfer = DisplacementTransfer(np.zeros((4, 3)), np.zeros((1, 3), int))
    plan = SurfacePlan(transfer, np.array([0, 2.5, 10]), kept(d), 1)
    np.testing.assert_array_equal([plan.displacement(0), plan.displacement(10)], d[[0, 2]])
    np.testing.assert_allclose(plan.displacement(1), 0.6 * d[0] + 0.4 * d[1])
    np.testing.assert_allclose(plan.displacement(4), 0.8 * d[1] + 0.2 * d[2])
    alone = replace(plan, keyframes=np.zeros(1), displacements=kept(d[:1]))
    np.testing.assert_array_equal([alone.displacement(0), alone.displacement(7)], d[[0, 0]])
    np.testing.assert_array_equal(replace(plan, scale=0.25).displacement(10), 0.25 * d[2])


@pytest.fixture(scope="module")
def gallop(creature) -> MeshAnimation:
    return creature.select([0, 8, 16])


@pytest.fixture(scope="module")
def gallop_plan(gallop) -> SurfacePlan:
    return Apex().plan(gallop, WORDS)


@pytest.mark.slow
def test_keyframes_before_and_after_the_middle_come_out_alike_in_any_number_of_processes():
    coarse = build_creature(points=3000).select([0, 8, 16])
    plans = [Apex(hold=1).plan(coarse, WORDS, jobs=jobs) for jobs in (1, 2)]
    for t in range(3):
        np.testing.assert_array_equal(plans[0].displacement(t), plans[1].displacement(t))
    assert len(plans[0].keyframes) == 3
    assert plans[0].displacement(0).any()


def mean_mrms(plan, animation):
    found = [
        surface_distance(frame.points, frame.faces, plan.mark(t, frame), frame.faces, seed=1)
        for t, frame in enumerate(animation)
    ]
    return np.mean([item.mrms / item.diagonal for item in found])


def test_a_marked_creature_keeps_its_surface_and_turns_no_face(gallop, gallop_plan):
    assert mean_mrms(gallop_plan, gallop) <= Apex().parameters.max_mrms
    for t, frame in enumerate(gallop):
        after = area_vectors(gallop_plan.mark(t, frame), frame.faces)
        assert np.vecdot(area_vectors(frame.points, frame.faces), after).min() > 0.0


def test_what_one_pose_would_hold_back_is_held_back_in_all(gallop, gallop_plan):
    for t, frame in enumerate(gallop):
        surface = ClosestPoints(frame.points, frame.faces)
        _, share, _ = gallop_plan.transfer.apply(frame.points, gallop_plan.displacement(t), surface)
        assert np.mean(share < 1.0) < 1e-3


def test_anchors_stay_where_they_are(gallop, gallop_plan):
    length = np.linalg.norm(gallop_plan.displacement(0).reshape(-1, 3), axis=1)
    assert length[lasting_anchors(FrameAnchors(gallop, 1), 8)].max() < 1e-4 * length.max()


def test_marking_fits_what_was_laid_on_the_surface_to_it(gallop, gallop_plan):
    P, F = gallop[0].points, gallop[0].faces
    transferred, *_ = gallop_plan.transfer.apply(
        P, gallop_plan.displacement(0), ClosestPoints(P, F)
    )
    assert mrms(P, F, gallop_plan.mark(0, gallop[0]), F) < 0.7 * mrms(P, F, transferred, F)


def test_what_was_marked_to_measure_the_limit_is_not_marked_again(gallop, gallop_plan):
    assert gallop_plan.known
    for t in gallop_plan.known:
        np.testing.assert_array_equal(
            gallop_plan.mark(t, gallop[t]), replace(gallop_plan, known={}).mark(t, gallop[t])
        )


@pytest.mark.slow
def test_a_plan_is_weakened_to_the_limit_and_not_much_below_it(gallop, gallop_plan):
    limit = 0.4 * mean_mrms(gallop_plan, gallop)
    weaker = limit_mrms(gallop_plan, gallop, limit)
    assert 0.9 * limit < mean_mrms(weaker, gallop) <= limit
    # All of it alike.
    for t in range(3):
        np.testing.assert_allclose(
            weaker.displacement(t), weaker.scale * gallop_plan.displacement(t), atol=1e-12
        )
    assert limit_mrms(gallop_plan, gallop, 1e-2).scale == gallop_plan.scale
