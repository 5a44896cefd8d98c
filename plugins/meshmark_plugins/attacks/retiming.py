"""Frames at other times: picked, or blended linearly between two of the source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation


@dataclass(frozen=True)
class RetimedFrames:
    """Blends of two frames of another source.

    Parameters
    ----------
    base : FrameSource
        The frames before.
    times : tuple of float
        Time code of each frame.
    before, after : tuple of int
        Index of the two frames each is blended from.
    shares : tuple of float
        Share of the second, in [0, 1]; 0 gives the first alone, 1 the second.
    """

    base: FrameSource
    times: tuple[float, ...]
    before: tuple[int, ...]
    after: tuple[int, ...]
    shares: tuple[float, ...]

    def frame(self, index: int) -> Frame:
        """Read and blend the two frames of frame `index`."""
        share = self.shares[index]
        whole = self.after[index] if share == 1.0 else self.before[index]
        frame = replace(self.base.frame(whole), time=self.times[index])
        if share in (0.0, 1.0):
            return frame
        other = self.base.frame(self.after[index])
        return frame.moved((1.0 - share) * frame.points + share * other.points)


def interpolate(
    animation: MeshAnimation, keys: Sequence[int], times: FloatArray, at: FloatArray
) -> MeshAnimation:
    """Return an animation that runs linearly between some frames of another.

    Parameters
    ----------
    animation : MeshAnimation
        One connectivity for all frames.
    keys : sequence of int
        Indices of the frames it runs between, increasing.
    times : (T,) float64
        Time codes of the result.
    at : (T,) float64
        Moment of the source each shows; beyond the first or last key, that key.
    """
    knots = animation.times[list(keys)]
    after = np.clip(np.searchsorted(knots, at, side="left"), 1, max(len(knots) - 1, 1))
    after = np.minimum(after, len(knots) - 1)
    before = np.maximum(after - 1, 0)
    gap = knots[after] - knots[before]
    share = np.divide(at - knots[before], gap, out=np.zeros(len(at)), where=gap > 0)
    index = np.asarray(keys)
    source = RetimedFrames(
        animation.source,
        tuple(times.tolist()),
        tuple(index[before].tolist()),
        tuple(index[after].tolist()),
        tuple(np.clip(share, 0.0, 1.0).tolist()),
    )
    return replace(animation, times=times, source=source)
