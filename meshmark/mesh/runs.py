"""Runs of frames with one connectivity, in an animation whose connectivity changes.

A simulation, or a cache that was remeshed, shows the same prim with other vertices from some frame
on. Between such frames vertices keep their identity: a run is an animation of its own.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace

from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation
from meshmark.mesh.frame_range import spread
from meshmark.mesh.topology import Topology


@dataclass(frozen=True)
class JoinedFrames:
    """Frames of another source, some runs of which come from sources of their own.

    Parameters
    ----------
    base : FrameSource
        All frames.
    runs : tuple of range
        Indices of those that come from elsewhere, increasing.
    sources : tuple of FrameSource
        Where each run comes from; its frames are counted from 0.
    """

    base: FrameSource
    runs: tuple[range, ...]
    sources: tuple[FrameSource, ...]

    def frame(self, index: int) -> Frame:
        """Read frame `index`."""
        at = bisect_right([run.start for run in self.runs], index) - 1
        if at >= 0 and index in self.runs[at]:
            return self.sources[at].frame(index - self.runs[at].start)
        return self.base.frame(index)


def runs(animation: MeshAnimation) -> list[range]:
    """List the runs of consecutive frames with one connectivity, by their indices.

    Of an animation whose connectivity does not change there is one. Frames that cannot be read
    belong to none. Frames are read one at a time.
    """
    if animation.constant_topology:
        return [range(len(animation))]
    found: list[range] = []
    last: Topology | None = None
    for index in range(len(animation)):
        try:
            topology = animation[index].topology
        except InputError:
            last = None
            continue
        if last is not None and last.same_as(topology):
            found[-1] = range(found[-1].start, index + 1)
        else:
            found.append(range(index, index + 1))
            last = topology
    return found


def longest(every: Sequence[range], most: int) -> list[range]:
    """Choose at most so many runs, the longest; of equal ones some that are spread evenly."""
    lengths = sorted((len(run) for run in every), reverse=True)
    long = [run for run in every if len(run) >= lengths[:most][-1]]
    return [long[i] for i in spread(len(long), most)]


def cut(animation: MeshAnimation, run: range) -> MeshAnimation:
    """Return the animation of one run."""
    if len(run) == len(animation):
        return replace(animation, constant_topology=True)
    return replace(animation.select(run), constant_topology=True)


def joined(
    animation: MeshAnimation, at: Sequence[range], parts: Sequence[MeshAnimation]
) -> MeshAnimation:
    """Put runs of an animation back in their places; other frames stay as they are.

    Parameters
    ----------
    at : sequence of range
        Indices of each run, increasing.
    parts : sequence of MeshAnimation
        What is to be there.
    """
    notes = (note for part in parts for note in part.notes)
    sources = tuple(part.source for part in parts)
    return replace(
        animation,
        source=JoinedFrames(animation.source, tuple(at), sources),
        notes=tuple(dict.fromkeys((*animation.notes, *notes))),
    )


def span(animation: MeshAnimation) -> str:
    """Say when an animation begins and ends, as a range of time codes."""
    return f"{animation.times[0]:.12g}:{animation.times[-1]:.12g}"
