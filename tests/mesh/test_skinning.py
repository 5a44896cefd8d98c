"""What a file says of joints is counted anew, or passed over where it is no skinning."""

from __future__ import annotations

import numpy as np
import pytest

from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.skinning import MOST_INFLUENCES, MOST_JOINTS, Skinning
from meshmark.testing.meshes import icosphere

REST = np.arange(12.0).reshape(4, 3)
JOINTS = np.array([[7, 3], [3, -5], [9, 9], [3, 7]])
WEIGHTS = np.full((4, 2), 0.5)


def test_joints_are_counted_anew() -> None:
    found = Skinning.fit(REST, JOINTS, WEIGHTS)
    assert found is not None
    np.testing.assert_array_equal(found.joints, [[2, 1], [1, 0], [3, 3], [1, 2]])
    some = found.of(np.array([3, 0]))
    np.testing.assert_array_equal(some.rest, REST[[3, 0]])
    np.testing.assert_array_equal(some.joints, [[1, 2], [2, 1]])


NOTHING = {
    "fewer points": (REST[:3], JOINTS, WEIGHTS),
    "fewer weights": (REST, JOINTS, WEIGHTS[:, :1]),
    "no joints": (REST, JOINTS[:, :0], WEIGHTS[:, :0]),
    "no points": (REST[:0], JOINTS[:0], WEIGHTS[:0]),
    "a weight that is no number": (REST, JOINTS, WEIGHTS * [1.0, np.nan]),
    "a point that is nowhere": (REST + np.inf, JOINTS, WEIGHTS),
    "too many joints of one point": (
        REST,
        np.zeros((4, MOST_INFLUENCES + 1), dtype=int),
        np.zeros((4, MOST_INFLUENCES + 1)),
    ),
    "too many joints": (
        np.zeros((MOST_JOINTS + 1, 3)),
        np.arange(MOST_JOINTS + 1)[:, None],
        np.ones((MOST_JOINTS + 1, 1)),
    ),
}


@pytest.mark.parametrize("what", NOTHING)
def test_what_is_no_skinning_is_passed_over(what) -> None:
    assert Skinning.fit(*NOTHING[what]) is None


class _Frames:
    """A frame that knows how joints move its points."""

    def __init__(self, mesh: MeshAnimation) -> None:
        self.frame = mesh.source.frame

    def skinning(self) -> Skinning | None:
        return Skinning.fit(REST, JOINTS, WEIGHTS)


def test_it_goes_with_chosen_frames_and_not_with_changed_ones() -> None:
    V, F = icosphere(0)
    still = MeshAnimation.from_arrays(V, F)
    assert still.skinning is None
    mesh = MeshAnimation(still.times, _Frames(still))
    assert mesh.skinning is not None
    assert mesh.select([0]).skinning is not None
    assert mesh.map(lambda frame: frame).skinning is None
