"""Frames that are no poses of their own: straight blends of those before and after.

USD blends linearly between time samples, and so does whoever resamples a copy. Vertices that
turned about a joint in the original cut the corner in a blend: it shows distances that no pose
ever had, and nothing that its neighbours do not show better.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import InputError
from meshmark.mesh.animation import MeshAnimation

# Farthest that a blend lies from the straight line between its neighbours, as a share of what
# moves between them: well above rounding to float32, well below what bends in a real motion.
STRAIGHT = 1e-3


def own_poses(animation: MeshAnimation, frames: Sequence[int]) -> list[int]:
    """Leave out the frames that are blends of those next to them.

    Parameters
    ----------
    animation : MeshAnimation
        Any; without a constant topology nothing is left out.
    frames : sequence of int
        Indices of frames.

    Returns
    -------
    list of int
        Those that are poses of their own; `frames` themselves if none is.
    """
    if not animation.constant_topology:
        return list(frames)
    points = _RecentPoints(animation)
    kept = [t for t in frames if not _is_blend(points, t)]
    return kept or list(frames)


class _RecentPoints:
    """Points of the frames read last: those of one frame are compared with its neighbours' twice.

    Parameters
    ----------
    animation : MeshAnimation
        Where they are read from.
    """

    def __init__(self, animation: MeshAnimation) -> None:
        self.times = animation.times
        self._animation = animation
        self._known: dict[int, FloatArray | InputError] = {}

    def about(self, index: int) -> list[FloatArray] | None:
        """Return the points (N, 3) of a frame and its neighbours; None if one cannot be read."""
        wanted = range(index - 1, index + 2)
        self._known = {t: self._known[t] if t in self._known else self._read(t) for t in wanted}
        read = [points for points in self._known.values() if not isinstance(points, InputError)]
        return read if len(read) == len(wanted) else None

    def _read(self, index: int) -> FloatArray | InputError:
        try:
            return self._animation[index].points
        except InputError as error:
            return error


def _is_blend(points: _RecentPoints, index: int) -> bool:
    """Tell whether a frame lies on the straight line between the one before and the one after.

    A mesh that does not move from one to the other is at rest, not blended.
    """
    if not 0 < index < len(points.times) - 1:
        return False
    times = points.times[index - 1 : index + 2]
    if not np.all(np.diff(times) > 0.0):
        return False
    three = points.about(index)
    if three is None:
        # Nothing can be said beside a frame that cannot be read.
        return False
    before, own, after = three
    share = (times[1] - times[0]) / (times[2] - times[0])
    motion = after - before
    away = np.linalg.norm(own - before - share * motion)
    resolution = np.finfo(np.float32).eps * np.linalg.norm(own)
    moved = float(np.linalg.norm(motion))
    return bool(moved * STRAIGHT > resolution and away <= moved * STRAIGHT)
