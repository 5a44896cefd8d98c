"""Folds of a displacement, in one pose and in several."""

from __future__ import annotations

import numpy as np

from meshmark.testing.meshes import plane
from meshmark_plugins.schemes.apex.marking.fold_smoother import FoldSmoother


def unmoved(V):
    """Gradients of a pose that is the reference itself."""
    return V, np.broadcast_to(np.eye(3), (len(V), 3, 3))


def middle(V):
    """The vertex nearest to the centre."""
    return int(np.argmin(np.linalg.norm(V - V.mean(axis=0), axis=1)))


def test_folds_are_smoothed_out_and_what_does_not_fold_is_left_alone():
    V, F = plane(21)
    every = np.arange(len(F))
    smoother = FoldSmoother(F, 1.0, [unmoved(V)])
    calm = 0.01 * np.sin(2 * np.pi * V)
    np.testing.assert_array_equal(smoother.smooth_folds(calm.ravel()), calm.ravel())
    # One vertex jumps over its neighbours.
    jump = calm.copy()
    jump[middle(V)] += [0.11, 0.02, 0.0]
    assert smoother.folded_faces(jump, every).any()
    smoothed = smoother.smooth_folds(jump.ravel()).reshape(-1, 3)
    assert not smoother.folded_faces(smoothed, every).any()
    # Far from it nothing moved.
    far = np.linalg.norm(V - V[middle(V)], axis=1) > 0.3
    np.testing.assert_array_equal(smoothed[far], calm[far])


def test_a_fold_in_any_pose_is_smoothed():
    V, F = plane(21)
    every = np.arange(len(F))
    jump = np.zeros_like(V)
    jump[middle(V), 0] = 0.04
    # In the second pose the plane is drawn out along y, and moves along x are twice as long.
    G = np.broadcast_to(np.diag([2.0, 3.0, 1.0]), (len(V), 3, 3))
    assert not FoldSmoother(F, 1.0, [unmoved(V)]).folded_faces(jump, every).any()
    pose = V * [1.0, 3.0, 1.0], G
    assert FoldSmoother(F, 1.0, [unmoved(V), pose]).folded_faces(jump, every).any()


def test_faces_that_no_move_touches_need_not_be_looked_at_again(monkeypatch):
    rng = np.random.default_rng(3)
    V, F = plane(21)
    torn = 0.06 * rng.normal(size=V.shape) * (rng.random((len(V), 1)) < 0.1)
    asked = []
    fresh = FoldSmoother(F, 1.0, [unmoved(V), unmoved(V[:, [1, 2, 0]])])
    folded_faces = fresh.folded_faces

    def noted(moves, faces):
        asked.append(len(faces))
        found = folded_faces(moves, faces)
        every = np.flatnonzero(folded_faces(moves, np.arange(len(F))))
        np.testing.assert_array_equal(faces[found], every)
        return found

    monkeypatch.setattr(fresh, "folded_faces", noted)
    fresh.smooth_folds(torn.ravel())
    assert len(asked) > 2
    assert max(asked[1:]) < asked[0] == len(F)
