"""Skinning: which joints move each point of a mesh, and by how much."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from meshmark.arrays import FloatArray, IntArray

# A rig of more joints, or of more that move one point, is passed over: fitting its joints takes
# memory that grows with the square of their number.
MOST_JOINTS, MOST_INFLUENCES = 512, 64


@dataclass(frozen=True, eq=False)
class Skinning:
    """How joints move the points of a mesh, wherever these joints may be.

    Parameters
    ----------
    rest : (N, 3) float64
        The points before joints move them, in any space.
    joints : (N, n) int
        Joints that move each of them; below `MOST_JOINTS`.
    weights : (N, n) float64
        By how much.
    """

    rest: FloatArray
    joints: IntArray
    weights: FloatArray

    @classmethod
    def fit(cls, rest: FloatArray, joints: IntArray, weights: FloatArray) -> Skinning | None:
        """Build it from what a file says; None if that is no skinning, or too much of it.

        Joints are any integers; they are counted anew.
        """
        if joints.shape != weights.shape or joints.shape[:1] != rest.shape[:1]:
            return None
        if not 0 < joints.shape[1] <= MOST_INFLUENCES or not len(rest):
            return None
        if not np.isfinite(rest).all() or not np.isfinite(weights).all():
            return None
        used, numbers = np.unique(joints, return_inverse=True)
        if len(used) > MOST_JOINTS:
            return None
        return cls(rest, numbers.reshape(joints.shape), weights)

    def of(self, kept: IntArray) -> Skinning:
        """Return that of some of the points."""
        return Skinning(self.rest[kept], self.joints[kept], self.weights[kept])


@runtime_checkable
class SkinnedFrames(Protocol):
    """What a source of frames may offer, too: how joints move its points."""

    def skinning(self) -> Skinning | None:
        """Return that; None if it is not known."""
        ...


def skinning_of(source: Any) -> Skinning | None:
    """Return how joints move the points of a source of frames, if it knows.

    Frames that are seen through a function may have other points: of them nothing is known.
    """
    return source.skinning() if isinstance(source, SkinnedFrames) else None
