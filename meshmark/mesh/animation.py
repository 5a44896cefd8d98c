"""What everything passes around: frames, the animation of one mesh, the asset that holds them."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError, UsageError
from meshmark.mesh.skinning import Skinning, skinning_of
from meshmark.mesh.topology import Topology


@dataclass(frozen=True, eq=False)
class Frame:
    """One mesh at one time.

    Parameters
    ----------
    time : float
        Time code in the source's own units; NaN for a value that has no time (USD's default).
    points : (N, 3) float64
        Vertex positions in world space, in the source's length unit.
    topology : Topology
        The polygons.
    as_found : Frame or None
        What this one was made of, where it shows a copy as it may have been before an attack.
    """

    time: float
    points: FloatArray
    topology: Topology
    as_found: Frame | None = None

    @property
    def faces(self) -> IntArray:
        """Triangles for analysis, (F, 3) int."""
        return self.topology.triangles

    def moved(self, points: FloatArray) -> Frame:
        """Return this frame with other vertex positions."""
        return replace(self, points=points)


class FrameSource(Protocol):
    """Where an animation's frames come from: asked by index, again and again, lazily.

    Must pickle, so that worker processes can read frames by themselves, and must not keep
    frames it has handed out.
    """

    def frame(self, index: int) -> Frame:
        """Read frame `index` (0-based, in time order)."""
        ...


@dataclass(frozen=True)
class InMemoryFrames:
    """Frames held in memory: for fixtures, attacks that need them all, and single meshes."""

    frames: tuple[Frame, ...]

    def frame(self, index: int) -> Frame:
        """Return frame `index`."""
        return self.frames[index]


@dataclass(frozen=True)
class MappedFrames:
    """Frames of another source seen through a function, one at a time."""

    base: FrameSource
    function: Callable[[Frame], Frame]

    def frame(self, index: int) -> Frame:
        """Read frame `index` of the base and apply the function."""
        return self.function(self.base.frame(index))


@dataclass(frozen=True)
class SelectedFrames:
    """Some frames of another source, in the given order."""

    base: FrameSource
    indices: tuple[int, ...]

    def frame(self, index: int) -> Frame:
        """Read the frame that is number `index` of the selection."""
        return self.base.frame(self.indices[index])

    def skinning(self) -> Skinning | None:
        """Return how joints move the points of all frames, if that is known."""
        return skinning_of(self.base)


@dataclass(frozen=True)
class RememberedFrames:
    """Frames of another source, of which those asked for last are kept, up to `count`."""

    base: FrameSource
    count: int
    kept: OrderedDict[int, Frame] = field(default_factory=OrderedDict)

    def __reduce__(self) -> tuple[type[RememberedFrames], tuple[FrameSource, int]]:
        return RememberedFrames, (self.base, self.count)

    def frame(self, index: int) -> Frame:
        """Read frame `index`, unless it is kept."""
        found = self.kept.pop(index, None) or self.base.frame(index)
        self.kept[index] = found
        if len(self.kept) > self.count:
            self.kept.popitem(last=False)
        return found

    def skinning(self) -> Skinning | None:
        """Return how joints move the points of all frames, if that is known."""
        return skinning_of(self.base)


@dataclass(frozen=True, eq=False)
class MeshAnimation:
    """One mesh over time: time codes, and frames that are read when asked for.

    Parameters
    ----------
    times : (T,) float64
        Strictly increasing time codes; a single NaN for a mesh without time samples.
    source : FrameSource
        Where the frames come from.
    constant_topology : bool
        Whether every frame has the same polygons over the same number of points, so that
        vertex j is the same material point in all of them (a vertex trajectory).
    prim : str
        Path of the mesh inside its file (a USD prim path, a glTF node path); "/" if there is
        only one nameless mesh.
    origin : str
        File, folder or glob the animation was read from, for messages and manifests.
    notes : tuple of str
        What a person should know about how it was read (for instance: skinned, rest pose).
    in_place : bool
        Whether its points can be replaced where they stand.
    shared : str
        Equal for meshes that show the same points: replacing those of one replaces those of all.
        Empty for a mesh that has points of its own.
    dtype : str
        Type of the source's coordinates: "float16", "float32" or "float64". Frames are
        float64 whatever it is; a copy is written in it.
    rounding : float or None
        What points are rounded to where they are stored, as a share of the diagonal; see
        `meshmark.mesh.precision`. None where they are stored as they stand in world space.
    flaw : str
        What is wrong with faces that had to be left out: the mesh can be looked at, not marked.
    """

    times: FloatArray
    source: FrameSource
    constant_topology: bool = True
    prim: str = "/"
    origin: str = ""
    notes: tuple[str, ...] = ()
    in_place: bool = True
    shared: str = ""
    dtype: str = "float32"
    rounding: float | None = None
    flaw: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", np.asarray(self.times, dtype=np.float64))
        if self.times.size == 0:
            raise InputError("the mesh has no frames", source=self.origin, prim=self.prim)
        if self.times.size > 1 and not np.all(np.diff(self.times) > 0):
            raise InputError(
                "time codes must be strictly increasing", source=self.origin, prim=self.prim
            )

    def __len__(self) -> int:
        return int(self.times.size)

    def __getitem__(self, index: int) -> Frame:
        if not -len(self) <= index < len(self):
            raise IndexError(index)
        return self.source.frame(index % len(self))

    def __iter__(self) -> Iterator[Frame]:
        for index in range(len(self)):
            yield self.source.frame(index)

    @classmethod
    def from_frames(
        cls, frames: Sequence[Frame], *, prim: str = "/", origin: str = ""
    ) -> MeshAnimation:
        """Build an animation from frames in memory."""
        first = frames[0].topology
        return cls(
            times=np.array([frame.time for frame in frames]),
            source=InMemoryFrames(tuple(frames)),
            constant_topology=all(first.same_as(frame.topology) for frame in frames),
            prim=prim,
            origin=origin,
        )

    @classmethod
    def from_arrays(
        cls,
        points: FloatArray,
        faces: IntArray,
        *,
        times: FloatArray | None = None,
        prim: str = "/",
        origin: str = "",
    ) -> MeshAnimation:
        """Build an animation from points (T, N, 3) or (N, 3) and triangles (F, 3)."""
        stack = np.asarray(points, dtype=np.float64)
        stack = stack[None] if stack.ndim == 2 else stack
        clock = np.arange(1.0, len(stack) + 1) if times is None else np.asarray(times)
        topology = Topology.from_triangles(faces, stack.shape[1])
        frames = [Frame(float(t), P, topology) for t, P in zip(clock, stack, strict=True)]
        return cls.from_frames(frames, prim=prim, origin=origin)

    @property
    def skinning(self) -> Skinning | None:
        """How joints move its points, if its source knows."""
        return skinning_of(self.source)

    def map(self, function: Callable[[Frame], Frame]) -> MeshAnimation:
        """Return this animation seen through `function`, applied lazily frame by frame.

        The function must keep times, and, if the topology is constant, keep it so.
        """
        return replace(self, source=MappedFrames(self.source, function))

    def remembered(self, count: int) -> MeshAnimation:
        """Return the same animation, which keeps the frames it was asked for last, so many."""
        return replace(self, source=RememberedFrames(self.source, count))

    def select(self, indices: Sequence[int]) -> MeshAnimation:
        """Return the animation of the frames at `indices` (increasing)."""
        chosen = tuple(int(i) for i in indices)
        if not chosen:
            raise UsageError("the frame range holds no frame", source=self.origin, prim=self.prim)
        return replace(
            self, times=self.times[list(chosen)], source=SelectedFrames(self.source, chosen)
        )
