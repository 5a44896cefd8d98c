"""What everything passes around: frames, the animation of one mesh, the asset that holds them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError, UsageError
from meshmark.mesh.topology import triangulate


@dataclass(frozen=True, eq=False)
class Topology:
    """Polygons over `n_points` points, and their triangles for analysis.

    Parameters
    ----------
    counts : (P,) int
        Corners of each polygon.
    indices : (sum(counts),) int
        Point index of each corner, polygon after polygon.
    n_points : int
        Number of points the indices refer to.
    left_out : str
        What is wrong with polygons that were left out; see `fit`.

    Raises
    ------
    InputError
        If an index is out of range, a polygon has fewer than three corners, or counts and
        indices do not agree.
    """

    counts: IntArray
    indices: IntArray
    n_points: int
    left_out: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "counts", np.ascontiguousarray(self.counts, dtype=np.int64))
        object.__setattr__(self, "indices", np.ascontiguousarray(self.indices, dtype=np.int64))
        if self.counts.size == 0:
            raise InputError("the mesh has no faces")
        if self.counts.min() < 3:
            raise InputError("the mesh has a face with fewer than three corners")
        # One by one first: the sum of numbers out of a file may overflow.
        largest = int(self.counts.max())
        corners = largest if largest > self.indices.size else int(self.counts.sum())
        if corners != self.indices.size:
            raise InputError(
                f"face counts ask for {corners} corners, but {self.indices.size} indices are given"
            )
        low, high = int(self.indices.min()), int(self.indices.max())
        if low < 0 or high >= self.n_points:
            raise InputError(
                f"face index {low if low < 0 else high} is out of range for {self.n_points} points"
            )

    @classmethod
    def fit(cls, counts: IntArray, indices: IntArray, n_points: int) -> Topology:
        """Build a topology of those polygons that are any, if there are some.

        One bad index in a copy must not keep the rest of it from being looked at. What was left
        out is told in `left_out`; `meshmark.mesh.checks.check` refuses it.
        """
        try:
            return cls(counts, indices, n_points)
        except InputError as error:
            if len(counts) == 0 or counts.min() < 0 or counts.max() > len(indices):
                raise
            if counts.sum() != len(indices):
                raise
            polygon = np.repeat(np.arange(len(counts)), counts)
            kept = counts >= 3
            kept[polygon[(indices < 0) | (indices >= n_points)]] = False
            if not kept.any():
                raise
            told = f"{np.sum(~kept)} of {len(kept)} faces cannot be used: {error.message}"
            return cls(counts[kept], indices[kept[polygon]], n_points, told)

    @classmethod
    def from_triangles(cls, faces: IntArray, n_points: int) -> Topology:
        """Build a topology of triangles, `faces` (F, 3) int."""
        return cls(np.full(len(faces), 3, dtype=np.int64), np.asarray(faces).reshape(-1), n_points)

    @cached_property
    def triangles(self) -> IntArray:
        """Polygons as a fan of triangles, (F, 3) int, in polygon order."""
        return triangulate(self.counts, self.indices)

    def digest(self) -> bytes:
        """Return what is equal for topologies that are the same."""
        found = hashlib.blake2b(self.counts.tobytes(), digest_size=16)
        found.update(self.indices.tobytes())
        found.update(f"{self.n_points} {self.left_out}".encode())
        return found.digest()

    def same_as(self, other: Topology) -> bool:
        """Tell whether both describe the same polygons over the same number of points."""
        return self is other or (
            self.n_points == other.n_points
            and np.array_equal(self.counts, other.counts)
            and np.array_equal(self.indices, other.indices)
        )


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
    """

    time: float
    points: FloatArray
    topology: Topology

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
        Whether its points can be replaced where they stand; not so inside a USD instance.
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

    def map(self, function: Callable[[Frame], Frame]) -> MeshAnimation:
        """Return this animation seen through `function`, applied lazily frame by frame.

        The function must keep times, and, if the topology is constant, keep it so.
        """
        return replace(self, source=MappedFrames(self.source, function))

    def select(self, indices: Sequence[int]) -> MeshAnimation:
        """Return the animation of the frames at `indices` (increasing)."""
        chosen = tuple(int(i) for i in indices)
        if not chosen:
            raise UsageError("the frame range holds no frame", source=self.origin, prim=self.prim)
        return replace(
            self, times=self.times[list(chosen)], source=SelectedFrames(self.source, chosen)
        )


@dataclass(frozen=True)
class LeftOut:
    """Something of a source that was not read, or not marked.

    Parameters
    ----------
    prim : str
        Path of the mesh, or of the prim that would hold it.
    reason : str
        Why.
    guide : bool
        Whether it only helps those who work on the source, and nobody expects a mark in it.
    """

    prim: str
    reason: str
    guide: bool = False


class SourceFacts(Protocol):
    """What else of a source was read with its frames, so that nobody has to open it again."""

    @property
    def files(self) -> tuple[tuple[str, str], ...]:
        """Absolute path and SHA-256 of each file the source consists of."""
        ...

    @property
    def reach(self) -> tuple[str, ...]:
        """Every file it could use; see `meshmark.sources.readers.files_in_reach`."""
        ...

    def texture_coordinates(self, prim: str) -> FloatArray | None:
        """Return those of a mesh; see `meshmark.sources.readers.texture_coordinates`."""
        ...


@dataclass(frozen=True, eq=False)
class Asset:
    """Everything read from one source: the animations of its meshes.

    Parameters
    ----------
    source : str
        What was asked for: a path, a folder or a glob.
    meshes : tuple of MeshAnimation
        One for each mesh that can be read, in the file's own order.
    reader : str
        Name of the reader that produced it ("usd", "obj", ...).
    up_axis : str
        "Y" or "Z".
    meters_per_unit : float
        Length of the source's unit in metres.
    fps : float
        Time codes per second.
    notes : tuple of str
        What a person should know about how it was read.
    left_out : tuple of LeftOut
        What of it was not read.
    facts : SourceFacts or None
        What was read with it; None where the source is asked again.
    """

    source: str
    meshes: tuple[MeshAnimation, ...]
    reader: str
    up_axis: str = "Y"
    meters_per_unit: float = 0.01
    fps: float = 24.0
    notes: tuple[str, ...] = field(default=())
    left_out: tuple[LeftOut, ...] = ()
    facts: SourceFacts | None = None

    @property
    def path(self) -> Path:
        """The source as a path."""
        return Path(self.source)

    def mesh(self, prim: str) -> MeshAnimation:
        """Return the animation of one prim.

        Raises
        ------
        UsageError
            If the asset has no such mesh; the message lists those it has.
        """
        for animation in self.meshes:
            if animation.prim == prim:
                return animation
        known = ", ".join(animation.prim for animation in self.meshes[:10])
        raise UsageError(f"no mesh at {prim}; there is {known}", source=self.source)


def as_asset(animation: MeshAnimation) -> Asset:
    """Wrap one animation as an asset of its own."""
    return Asset(source=animation.origin, meshes=(animation,), reader="memory")
