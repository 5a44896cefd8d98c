"""Anchors an animation keeps, the plan of its mark, what is refused, and frozen numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meshmark.demo import creature as build_creature
from meshmark.errors import CapacityError, UsageError
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import area_vectors
from meshmark.metrics.surface_distance import mrms, surface_distance
from meshmark.testing.meshes import bumpy_sphere, capsule, icosphere, plane, torus
from meshmark.workers.scratch import DOUBLE, ScratchFile
from meshmark_plugins.schemes.apex.anchors.components import reference_root_area
from meshmark_plugins.schemes.apex.anchors.track import (
    FrameAnchors,
    anchors_if_any,
    anchors_in_poses,
    lasting_anchors,
)
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import OFFSETS, ScaleHypotheses
from meshmark_plugins.schemes.apex.chips.unit_series import nearest_residue, relative_units
from meshmark_plugins.schemes.apex.marking.displacement_transfer import DisplacementTransfer
from meshmark_plugins.schemes.apex.marking.plan import (
    MAX_POSES_PER_KEYFRAME,
    SurfacePlan,
    poses_of_keyframe,
    require_capacity,
    spread_keyframes,
    within_limit,
)
from meshmark_plugins.schemes.apex.scheme import Apex

HORNS = np.array(
    [[1, 0.2, 0.1], [-0.3, 1, 0.2], [-0.6, -0.7, 0.5], [0.2, -0.5, -1], [-0.5, 0.3, -0.9]]
)
WIDTHS = np.array([0.34, 0.26, 0.32, 0.24, 0.3])
AT_REST = np.full((1, 5), 1.5)
WORDS = np.array(Key(bytes(range(32))).words("apex", Apex().n_words, Apex().n_chips))


def horned(heights) -> MeshAnimation:
    """Five horns of heights (T, 5) over time."""
    frames = [bumpy_sphere(4, HORNS, height, WIDTHS) for height in heights]
    return MeshAnimation.from_arrays(np.stack([V for V, _ in frames]), frames[0][1])


def lasting_horns(heights, most=8):
    """Which horns the lasting anchors are the tips of."""
    animation = horned(heights)
    axes = HORNS / np.linalg.norm(HORNS, axis=1, keepdims=True)
    tips = animation[0].points[lasting_anchors(FrameAnchors(animation, 1), most)]
    return np.argmax(tips @ axes.T, axis=1).tolist()


# Anchors that last.


def test_an_animation_has_the_anchors_of_its_rest_pose():
    swaying = 1.5 + 0.2 * np.sin(0.5 * np.arange(12)[:, None] + np.arange(5))
    assert sorted(lasting_horns(AT_REST)) == sorted(lasting_horns(swaying)) == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("frames_missed", "kept"), [(1, [0, 1, 2, 3, 4]), (2, [0, 1, 3, 4])])
def test_a_horn_that_is_missing_in_more_than_a_tenth_of_the_frames_is_dropped(frames_missed, kept):
    heights = np.full((12, 5), 1.5)
    heights[3 : 3 + frames_missed, 2] = 0.0
    assert sorted(lasting_horns(heights)) == kept


def test_of_too_many_anchors_the_most_prominent_are_kept():
    assert sorted(lasting_horns(np.array([[1.2, 1.8, 1.2, 1.8, 1.8]]), most=3)) == [1, 3, 4]


# Keyframes.


def test_fewer_frames_than_hold_have_one_key():
    assert spread_keyframes(1, 8).tolist() == spread_keyframes(8, 8).tolist() == [0.0]
    assert spread_keyframes(9, 8).tolist() == [0.0, 8.0]
    assert spread_keyframes(16, 8).tolist() == [0.0, 15.0]
    assert spread_keyframes(17, 8).tolist() == [0.0, 8.0, 16.0]
    assert spread_keyframes(3, 1).tolist() == [0.0, 1.0, 2.0]


@given(st.integers(1, 2000), st.integers(1, 100))
def test_keys_span_the_animation_at_least_hold_frames_apart(n_frames, hold):
    keyframes = spread_keyframes(n_frames, hold)
    assert keyframes[0] == 0.0
    if len(keyframes) > 1:
        assert keyframes[-1] == n_frames - 1
        # Never sooner: a mark that changes faster than it may would be seen.
        assert hold <= np.diff(keyframes).min() <= np.diff(keyframes).max() < 2 * hold
    else:
        assert n_frames - 1 < hold


@given(st.integers(1, 500), st.integers(1, 60))
def test_a_key_serves_the_frames_up_to_its_neighbours(n_frames, hold):
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


def test_frames_between_keys_blend_theirs():
    d = np.random.default_rng(0).normal(size=(3, 12))
    transfer = DisplacementTransfer(np.zeros((4, 3)), np.zeros((1, 3), int))
    plan = SurfacePlan(transfer, np.array([0, 2.5, 10]), kept(d), 1)
    np.testing.assert_array_equal([plan.displacement(0), plan.displacement(10)], d[[0, 2]])
    np.testing.assert_allclose(plan.displacement(1), 0.6 * d[0] + 0.4 * d[1])
    np.testing.assert_allclose(plan.displacement(4), 0.8 * d[1] + 0.2 * d[2])
    alone = replace(plan, keyframes=np.zeros(1), displacements=kept(d[:1]))
    np.testing.assert_array_equal([alone.displacement(0), alone.displacement(7)], d[[0, 0]])
    np.testing.assert_array_equal(replace(plan, scale=0.25).displacement(10), 0.25 * d[2])


# Marks.


def hypothesis_as_marked(frame):
    """Index among the hypotheses of a frame of the one it was marked under."""
    length = reference_root_area(frame.points, frame.faces)
    hypotheses = ScaleHypotheses.about(length)
    unit = relative_units(length, np.array([nearest_residue(length)]))
    kept = (hypotheses.jitter == 1.0) & (np.abs(hypotheses.scales(length) * unit - 1.0) < 1e-9)
    return int(np.flatnonzero(kept)[0]) * len(OFFSETS)


def test_every_horn_reads_the_word_it_was_given_and_did_not_before():
    animation = horned(AT_REST)
    frame, scheme = animation[0], Apex()
    anchors = require_capacity(FrameAnchors(animation, 1), scheme.parameters)
    plan = scheme.plan(animation, WORDS)
    words, hypothesis = WORDS[anchors.words], hypothesis_as_marked(frame)
    before, after = (
        scheme.observe(frame.moved(P)).soft[hypothesis] @ words.T
        for P in (frame.points, plan.mark(0, frame))
    )
    # Of 16 at the very best.
    assert np.diag(after).min() > 8.0
    assert np.abs(before).max() < 6.0


def test_anchors_are_where_each_pose_shows_them_and_stay_where_none_is_seen():
    heights = np.tile(AT_REST, (3, 1))
    # In the last pose, the first horn is gone.
    heights[2, 0] = 0.0
    animation = horned(heights)
    tips = lasting_anchors(FrameAnchors(horned(AT_REST), 1), 5)
    # Usual vertices beside the tips.
    V = animation[0].points
    beside = np.linalg.norm(V[tips][:, None] - V, axis=2).argsort(axis=1)[:, 1]
    found = anchors_in_poses(FrameAnchors(animation, 1), beside, [0, 2])
    assert sorted(found) == [0, 2]
    np.testing.assert_array_equal(found[0], tips)
    first = int(np.argmax(V[tips] @ HORNS[0]))
    shown = anchors_if_any(animation[2].points, animation[2].faces)[0]
    for c in range(5):
        assert found[2][c] == beside[c] if c == first else found[2][c] in shown


@pytest.fixture(scope="module")
def gallop(creature) -> MeshAnimation:
    return creature.select([0, 8, 16])


@pytest.fixture(scope="module")
def gallop_plan(gallop) -> SurfacePlan:
    return Apex().plan(gallop, WORDS)


@pytest.mark.slow
def test_keys_before_and_after_the_middle_come_out_alike_in_any_number_of_processes():
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
        _, share = gallop_plan.transfer.apply(frame.points, gallop_plan.displacement(t), surface)
        assert np.mean(share < 1.0) < 1e-3


def test_anchors_stay_where_they_are(gallop, gallop_plan):
    length = np.linalg.norm(gallop_plan.displacement(0).reshape(-1, 3), axis=1)
    assert length[lasting_anchors(FrameAnchors(gallop, 1), 8)].max() < 1e-4 * length.max()


def test_marking_fits_what_was_laid_on_the_surface_to_it(gallop, gallop_plan):
    P, F = gallop[0].points, gallop[0].faces
    transferred, _ = gallop_plan.transfer.apply(P, gallop_plan.displacement(0), ClosestPoints(P, F))
    assert mrms(P, F, gallop_plan.mark(0, gallop[0]), F) < 0.7 * mrms(P, F, transferred, F)


def test_a_plan_is_weakened_to_the_limit_and_not_much_below_it(gallop, gallop_plan):
    limit = 0.4 * mean_mrms(gallop_plan, gallop)
    weaker = within_limit(gallop_plan, gallop, limit)
    assert 0.9 * limit < mean_mrms(weaker, gallop) <= limit
    # All of it alike.
    for t in range(3):
        np.testing.assert_allclose(
            weaker.displacement(t), weaker.scale * gallop_plan.displacement(t), atol=1e-12
        )
    assert within_limit(gallop_plan, gallop, 1e-2) is gallop_plan


# What is refused.


REFUSED = {
    "sphere": (icosphere(4), "tips such as hands, feet.*choose another scheme"),
    "torus": (torus(60, 30), "mark the mesh this one is worn by.*choose another scheme"),
    "plane": (plane(40), "tips lie on open borders.*choose another scheme"),
    "prop": (capsule(14, 21), r"296 points give \d+ chips.*takes 40.*subdivide it"),
}


@pytest.mark.parametrize(("mesh", "reason"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_hold_a_mark_is_refused_with_what_to_do(mesh, reason):
    animation = MeshAnimation.from_arrays(*mesh)
    with pytest.raises(CapacityError, match=reason):
        Apex().require_capacity(animation)
    with pytest.raises(CapacityError, match=reason):
        Apex().plan(animation, WORDS)


def test_tips_on_an_open_border_are_left_out():
    V, F = capsule(48, 100, 0.6)
    below = F[(V[F, 2] < 1.3).all(axis=1)]
    kept, faces = np.unique(below, return_inverse=True)
    animation = MeshAnimation.from_arrays(V[kept], faces.reshape(-1, 3))
    tip = np.flatnonzero(kept == len(V) - 2)
    # The middle of the far tip, a vertex or two beside its pole, and nothing of the rim.
    [anchor] = lasting_anchors(FrameAnchors(animation, 1), 8)
    assert np.linalg.norm(V[kept][anchor] - V[kept][tip]) < 0.1


OUT_OF_RANGE = {
    "bins": [1, 65, 14.5, True, None],
    "width": [0.0, 0.5, -0.1, np.nan, "0.1"],
    "words": [1, 11, 8.0],
    "strength": [0, 1, np.inf],
    "max_mrms": [0.0, 0.1, -1e-4],
    "hold": [0, 10_001, 2.5],
}


@pytest.mark.parametrize(("name", "values"), OUT_OF_RANGE.items())
def test_a_parameter_out_of_range_is_named(name, values):
    for value in values:
        with pytest.raises(UsageError, match=rf"^scheme apex: {name} must be a .*, not "):
            Apex(**{name: value})


# Frozen: if these numbers change, marks that are out there cannot be read any more.

EVIDENCE_IN_PER_CENT = """
  31  -38  -11   32   -3   42   29    2  -41  -12  -26   -8   45   -8   60   18
 -41    4  -32   27   38  -17  -15    0  -11  -13  -51    3  -30   34    7  -10
 -15  -40  -11   68   35   42    3   15   27  -26   -1  -45  -16  -12    1   13
  22  -29   -9  -39    1    0   14   -8  -33  -20    7    6   18  -72   19   -2
  15  -29  -13  -38  -15   47   -7   13   10   10  -43   24   12   64   33   44
 -13    0  -25   45   -2  -19    0   29   14  -44   14  -10   40  -28    7    3
"""
POSITIONS = [53.78, 53.46, 53.77, 53.44, 55.46, 63.09]


def test_anchors_and_evidence_of_the_creature(creature):
    seen, hypothesis = Apex().observe(creature[0]), hypothesis_as_marked(creature[0])
    assert seen.vertices.tolist() == [327, 3180, 85, 2694, 0, 6935]
    wanted = np.array(EVIDENCE_IN_PER_CENT.split(), dtype=float).reshape(6, 16)
    np.testing.assert_allclose(100.0 * seen.soft[hypothesis], wanted, atol=0.6)
    np.testing.assert_allclose(seen.posterior.position[hypothesis], POSITIONS, atol=0.02)
