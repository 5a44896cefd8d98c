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
    smoother = FoldSmoother(F, 1.0, [unmoved(V)])
    calm = 0.01 * np.sin(2 * np.pi * V)
    np.testing.assert_array_equal(smoother.smooth_folds(calm.ravel()), calm.ravel())
    # One vertex jumps over its neighbours.
    jump = calm.copy()
    jump[middle(V)] += [0.11, 0.02, 0.0]
    assert smoother.folded_faces(jump).any()
    smoothed = smoother.smooth_folds(jump.ravel()).reshape(-1, 3)
    assert not smoother.folded_faces(smoothed).any()
    # Far from it nothing moved.
    far = np.linalg.norm(V - V[middle(V)], axis=1) > 0.3
    np.testing.assert_array_equal(smoothed[far], calm[far])


def test_a_fold_in_any_pose_is_smoothed():
    V, F = plane(21)
    jump = np.zeros_like(V)
    jump[middle(V), 0] = 0.04
    # In the second pose the plane is drawn out along y, and moves along x are twice as long.
    G = np.broadcast_to(np.diag([2.0, 3.0, 1.0]), (len(V), 3, 3))
    assert not FoldSmoother(F, 1.0, [unmoved(V)]).folded_faces(jump).any()
    pose = V * [1.0, 3.0, 1.0], G
    assert FoldSmoother(F, 1.0, [unmoved(V), pose]).folded_faces(jump).any()
