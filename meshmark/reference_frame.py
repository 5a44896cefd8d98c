"""Which frame the others are compared with: one that most agree with, wherever it stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meshmark.animation import Frame, MeshAnimation
from meshmark.errors import InputError
from meshmark.geometry import lengths

FloatArray = NDArray[np.float64]

# Frames that are asked, and edges that are measured in each.
SAMPLED_FRAMES, SAMPLED_EDGES = 12, 4096
# Poses of one body agree about the length of their edges: the median ratio is nearer to 1 than
# this, in logarithms, however it bends.
AGREED = 0.4


def reference_frame(animation: MeshAnimation, frames: Sequence[int]) -> int:
    """Choose the frame that most others agree with in the lengths of its edges.

    No single frame is to be trusted: junk in front of an animation, or a frame that cannot be
    read, must not decide how the others are measured. Of equals the first is chosen.

    Parameters
    ----------
    animation : MeshAnimation
        Where its connectivity changes, the first readable frame is chosen.
    frames : sequence of int
        Indices to choose among; of many, some evenly spaced ones.

    Raises
    ------
    InputError
        If none of those can be read; the first frame's reason.
    """
    chosen, read = [], []
    errors: list[InputError] = []
    for index in _spread(frames):
        try:
            read.append(readable(animation, index))
            chosen.append(index)
        except InputError as error:
            errors.append(error)
            continue
        if not animation.constant_topology or len(frames) == 1:
            return index
    if not chosen:
        raise errors[0]
    return chosen[_most_agreed(read)]


def readable(animation: MeshAnimation, index: int) -> Frame:
    """Read a frame that shows something: all points finite, and not all in one place.

    Raises
    ------
    InputError
        Naming file, prim and frame, if it does not.
    """
    frame = animation[index]
    finite = np.isfinite(frame.points).all(axis=1)
    if finite.all() and np.ptp(frame.points, axis=0).any():
        return frame
    first = int(np.argmin(finite))
    raise InputError(
        "the mesh has no extent"
        if finite.all()
        else f"point {first} is not finite: {frame.points[first].tolist()}",
        source=animation.origin,
        prim=animation.prim,
        time=frame.time,
    )


def _spread(frames: Sequence[int]) -> list[int]:
    places = np.linspace(0, len(frames) - 1, min(len(frames), SAMPLED_FRAMES)).round().astype(int)
    return [frames[place] for place in dict.fromkeys(places.tolist())]


def _most_agreed(frames: Sequence[Frame]) -> int:
    F = frames[0].faces
    step = -(-len(F) // SAMPLED_EDGES)
    a, b = F[::step, 0], F[::step, 1]
    log_length = np.log(
        np.maximum([lengths(frame.points[b] - frame.points[a]) for frame in frames], 1e-300)
    )
    away = np.median(np.abs(log_length[:, None] - log_length[None]), axis=2)
    return int(np.argmax((away <= AGREED).sum(axis=1)))
