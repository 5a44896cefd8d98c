"""The original in between its frames."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation
from meshmark.mesh.skinning import Skinning, skinning_of

REMEMBERED = 6


def posed(original: MeshAnimation, pose: float) -> Frame:
    """Blend the two frames about a real-valued index linearly.

    Parameters
    ----------
    original : MeshAnimation
        Of constant topology.
    pose : float
        Within [0, T - 1]; a whole number is that frame, exactly.
    """
    low, share = _split(original, pose)
    frame = original[low]
    if share == 0.0:
        return frame
    following = original[low + 1]
    time = (1.0 - share) * frame.time + share * following.time
    return Frame(time, (1.0 - share) * frame.points + share * following.points, frame.topology)


def motion(original: MeshAnimation, pose: float) -> FloatArray:
    """Compute the derivative of `posed` by the pose, (N, 3); at a whole number, of both sides."""
    low, share = _split(original, pose)
    first = max(low - 1, 0) if share == 0.0 else low
    last = min(low + 1, len(original) - 1)
    if first == last:
        return np.zeros_like(original[low].points)
    rate: FloatArray = (original[last].points - original[first].points) / (last - first)
    return rate


def remembered(original: MeshAnimation) -> MeshAnimation:
    """Return the same animation, which keeps the frames it was asked for last."""
    return replace(original, source=_RememberedFrames(original.source))


@dataclass(frozen=True)
class _RememberedFrames:
    base: FrameSource
    kept: OrderedDict[int, Frame] = field(default_factory=OrderedDict)

    def __reduce__(self) -> tuple[type[_RememberedFrames], tuple[FrameSource]]:
        return _RememberedFrames, (self.base,)

    def frame(self, index: int) -> Frame:
        if index in self.kept:
            self.kept.move_to_end(index)
        else:
            self.kept[index] = self.base.frame(index)
            if len(self.kept) > REMEMBERED:
                self.kept.popitem(last=False)
        return self.kept[index]

    def skinning(self) -> Skinning | None:
        return skinning_of(self.base)


def _split(original: MeshAnimation, pose: float) -> tuple[int, float]:
    low = min(int(np.floor(pose)), len(original) - 1)
    return low, float(pose) - low
