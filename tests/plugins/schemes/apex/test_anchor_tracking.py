"""Anchors that an animation keeps, and where each pose shows them."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from meshmark.errors import OutputError
from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.meshes import bumpy_sphere, capsule
from meshmark.workers.scratch import DOUBLE, ScratchFile
from meshmark_plugins.schemes.apex.anchors import track
from meshmark_plugins.schemes.apex.anchors.geodesic_field import geodesic_fields
from meshmark_plugins.schemes.apex.anchors.track import (
    FrameAnchors,
    RecurringPoses,
    anchors_if_any,
    anchors_in_poses,
    lasting_anchors,
)

HORNS = np.array(
    [[1, 0.2, 0.1], [-0.3, 1, 0.2], [-0.6, -0.7, 0.5], [0.2, -0.5, -1], [-0.5, 0.3, -0.9]]
)
WIDTHS = np.array([0.34, 0.26, 0.32, 0.24, 0.3])
AT_REST = np.full((1, 5), 1.5)


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


def test_a_pose_that_recurs_is_measured_once(monkeypatch):
    V, F = bumpy_sphere(3, HORNS, AT_REST[0], WIDTHS)
    jitter = 1e-5 * np.random.default_rng(0).normal(size=V.shape)
    one_moved = V.copy()
    one_moved[5] *= 1.001
    frames = [V, one_moved, np.add(V, [30.0, 0.0, -7.0]), V + jitter, 1.01 * V, one_moved]
    animation = MeshAnimation.from_arrays(np.stack(frames), F)
    poses = RecurringPoses(animation)
    assert [poses.first(t) for t in range(6)] == [0, 1, 0, 0, 4, 1]
    # The first that is asked about stands for the others.
    other = RecurringPoses(animation)
    assert [other.first(t) for t in (3, 0, 5, 1)] == [3, 3, 5, 5]
    measured = []
    monkeypatch.setattr(
        track.DetectInFrame, "__call__", lambda self, index: measured.append(index) or index
    )
    assert FrameAnchors(animation, 1).of(range(6)) == [0, 1, 0, 0, 4, 1]
    assert measured == [0, 1, 4]


def kept(d) -> ScratchFile:
    scratch = ScratchFile.create(len(d), d.shape[1] // 3, DOUBLE)
    for j, displacement in enumerate(d):
        scratch.write(j, displacement)
    return scratch


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
    [shown] = anchors_if_any(animation[2].points, animation[2].faces)
    shown = shown.component.vertices[shown.maxima.vertices]
    for c in range(5):
        assert found[2][c] == beside[c] if c == first else found[2][c] in shown


def test_a_tip_of_another_piece_nearby_is_another_anchor():
    """Two bodies with horns that nearly touch, one of which goes."""
    horn = np.array([[1.0, 0.0, 0.0]])
    poses = [bumpy_sphere(4, horn, height, 0.3)[0] for height in (1.5, 0.0)]
    mirrored, F = bumpy_sphere(4, -horn, 1.5, 0.3)
    mirrored[:, 0] += 2.0 * poses[0][:, 0].max() + 0.02
    n = len(mirrored)
    animation = MeshAnimation.from_arrays(
        np.stack([np.concatenate([V, mirrored]) for V in poses]), np.concatenate([F, F + n])
    )
    tips = np.array([np.argmax(poses[0][:, 0]), n + np.argmin(mirrored[:, 0])])
    detected, _ = FrameAnchors(animation, 1).of([1])[0]
    assert tips[1] in detected
    assert tips[0] not in detected
    found = anchors_in_poses(FrameAnchors(animation, 1), tips[:1], [0, 1])
    assert [found[0][0], found[1][0]] == [tips[0], tips[0]]


def test_distances_from_anchors_are_kept_for_each_pose():
    animation = horned(np.array([AT_REST[0], AT_REST[0] + 0.2, AT_REST[0]]))
    anchors = FrameAnchors(animation, 1)
    detected = anchors.of(range(3))
    assert [anchors.pose(t) for t in range(3)] == [0, 1, 0]
    there = pickle.loads(pickle.dumps(anchors.distances))
    for t in (0, 1):
        V, F = animation[t].points, animation[t].faces
        [wanted] = geodesic_fields(V, F, detected[t][0], proxies=anchors.proxies)
        [found] = there.of(t)
        assert (found.first, found.root_areas[0]) == (0, wanted.length_scale)
        some = wanted.anchors[[3, 1]]
        np.testing.assert_allclose(found.from_some(some), wanted.H[[3, 1]], atol=1e-6)
    # Of what was not looked at, nothing is known.
    assert there.of(2) == []
    del anchors
    assert not there.path.exists()
    with pytest.raises(OutputError, match="TMPDIR can name another folder"):
        there.keep(0, [])


def test_tips_on_an_open_border_are_left_out():
    V, F = capsule(48, 100, 0.6)
    below = F[(V[F, 2] < 1.3).all(axis=1)]
    kept, faces = np.unique(below, return_inverse=True)
    animation = MeshAnimation.from_arrays(V[kept], faces.reshape(-1, 3))
    tip = np.flatnonzero(kept == len(V) - 2)
    # The middle of the far tip, a vertex or two beside its pole, and nothing of the rim.
    [anchor] = lasting_anchors(FrameAnchors(animation, 1), 8)
    assert np.linalg.norm(V[kept][anchor] - V[kept][tip]) < 0.1
