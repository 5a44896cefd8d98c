"""Which frames agree with each other, and which one the others are compared with.

No single frame is to be trusted: junk in front of an animation, or a frame that cannot be read,
must not decide how the others are measured.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import lengths

# Frames that are sampled, and edges that are measured in each.
SAMPLED_FRAMES, SAMPLED_EDGES = 12, 1024
# Poses of one body agree about the length of their edges: the median ratio is nearer to 1 than
# this, in logarithms, however it bends.
AGREED = 0.25
# Most groups of frames that are told apart.
MOST_GROUPS = 4


class EdgeLengths:
    """How long edges are in the frames of an animation; built once, asked many times.

    Parameters
    ----------
    animation : MeshAnimation
        The frames among which some are asked for are read once.
    """

    def __init__(self, animation: MeshAnimation) -> None:
        self._animation = animation
        # What was sampled: log lengths of edges by frame, or why it cannot be read.
        self._sampled: dict[int, FloatArray | InputError] = {}

    def reference(self, frames: Sequence[int]) -> int:
        """Choose the frame that most others agree with in the lengths of its edges.

        Of equals the first is chosen; where none agrees with any other, the one whose edges are
        the shortest beside its size. Where the connectivity changes, the first readable one.

        Parameters
        ----------
        frames : sequence of int
            Indices to choose among; of many, some evenly spaced ones.

        Raises
        ------
        InputError
            If none of those can be read; the first frame's reason.
        """
        if not self._animation.constant_topology or len(frames) == 1:
            return _first_readable(self._animation, frames)
        chosen, edges = self._sample(frames)
        return int(chosen[_most_agreed(edges, _agreement(edges))])

    def groups(self) -> list[list[int]]:
        """Sort the frames into groups that agree with each other, the largest first.

        Returns
        -------
        list of list of int
            At most `MOST_GROUPS`. All frames, those that cannot be read included, if the
            `SAMPLED_FRAMES` that are sampled agree, or the connectivity changes.

        Raises
        ------
        InputError
            If none of those can be read; the first frame's reason.
        """
        everything = list(range(len(self._animation)))
        if not self._animation.constant_topology or len(everything) == 1:
            return [everything]
        if _agreement(self._sample(everything)[1]).all():
            return [everything]
        left, edges = _readable_ones((t, _measured(self._animation, t)) for t in everything)
        grouped: list[list[int]] = []
        while left.size and len(grouped) < MOST_GROUPS:
            agreed = _agreement(edges)
            own = agreed[_most_agreed(edges, agreed)]
            grouped.append(left[own].tolist())
            left, edges = left[~own], edges[~own]
        return grouped

    def _sample(self, frames: Sequence[int]) -> tuple[IntArray, FloatArray]:
        """Measure some of the frames; see `_readable_ones`."""
        spread = _spread(frames)
        for t in spread:
            if t not in self._sampled:
                self._sampled[t] = _measured(self._animation, t)
        return _readable_ones((t, self._sampled[t]) for t in spread)


def readable(animation: MeshAnimation, index: int) -> Frame:
    """Read a frame that shows something: all points finite, and not all in one place.

    Raises
    ------
    InputError
        Naming file, prim and frame, if it does not.
    """
    frame = animation[index]
    points = frame.points
    if np.isfinite(points).all() and (points != points[:1]).any():
        return frame
    finite = np.isfinite(points).all(axis=1)
    first = int(np.argmin(finite))
    raise InputError(
        "the mesh has no extent"
        if finite.all()
        else f"point {first} is not finite: {frame.points[first].tolist()}",
        source=animation.origin,
        prim=animation.prim,
        time=frame.time,
    )


def _first_readable(animation: MeshAnimation, frames: Iterable[int]) -> int:
    first: InputError | None = None
    for index in frames:
        try:
            readable(animation, index)
        except InputError as error:
            first = first or error
        else:
            return index
    assert first is not None
    raise first


def _spread(frames: Sequence[int]) -> list[int]:
    places = np.linspace(0, len(frames) - 1, min(len(frames), SAMPLED_FRAMES)).round().astype(int)
    return [frames[place] for place in dict.fromkeys(places.tolist())]


def _measured(animation: MeshAnimation, index: int) -> FloatArray | InputError:
    """Return `_edges` of a frame, or why it cannot be read."""
    try:
        return _edges(readable(animation, index))
    except InputError as error:
        return error


def _readable_ones(
    measured: Iterable[tuple[int, FloatArray | InputError]],
) -> tuple[IntArray, FloatArray]:
    """Return which frames could be read, (T,), and what was measured of each.

    Raises
    ------
    InputError
        If none could; the first frame's reason.
    """
    chosen: list[int] = []
    edges: list[FloatArray] = []
    errors: list[InputError] = []
    for index, of_frame in measured:
        if isinstance(of_frame, InputError):
            errors.append(of_frame)
        else:
            chosen.append(index)
            edges.append(of_frame)
    if not chosen:
        raise errors[0]
    return np.array(chosen), np.array(edges)


def _edges(frame: Frame) -> FloatArray:
    """Log length of some edges (n + 1,); last, of the size of the whole."""
    F = frame.faces
    step = -(-len(F) // SAMPLED_EDGES)
    a, b = frame.points[F[::step, 0]], frame.points[F[::step, 1]]
    size = np.median(lengths(frame.points - np.median(frame.points, axis=0)))
    return np.log(np.maximum([*lengths(b - a), size], 1e-300))


def _agreement(edges: FloatArray) -> BoolArray:
    """Tell which frames agree with which, (T, T)."""
    return np.array([np.median(np.abs(edges - own)[:, :-1], axis=1) <= AGREED for own in edges])


def _most_agreed(edges: FloatArray, agreed: BoolArray) -> int:
    """Choose the frame that most agree with; the first, or where none does, the least stretched."""
    votes = agreed.sum(axis=1)
    if votes.max() == 1:
        return int(np.argmin(np.median(edges[:, :-1], axis=1) - edges[:, -1]))
    return int(np.argmax(votes))
