"""What may have been marked by itself: meshes, the surfaces in them, meshes that were cut apart.

A copy can have a ground, a box or a second body joined to its mesh, a sheet attached to it, or
be cut into several meshes. What was marked is then one surface, or some, of what is found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.detection.reference_frame import EdgeLengths, readable
from meshmark.errors import CapacityError, InputError
from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.components import seams, sewn, surface_components
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.topology import Topology, face_components
from meshmark.mesh.welding import Welding

# A surface of fewer vertices holds no mark by itself.
FEWEST_VERTICES = 500
# Most surfaces of a mesh that are tried each by itself, the ones of the most vertices first; and
# among how many of them runs of neighbours are tried together.
MOST_SURFACES, MOST_IN_RUNS = 64, 5
# A cut has at least so many points on either side; fewer are some hole that nearly closed.
FEWEST_SEWN = 12
# Surfaces that all together have less than this share of the area change nothing about the rest.
NEGLIGIBLE = 0.02


@dataclass(frozen=True, eq=False)
class Candidate:
    """A mesh, or a part of one or several, that may have been marked by itself.

    Parameters
    ----------
    animation : MeshAnimation
        Its frames; named after the first of its prims.
    part : str
        Which part of the prim; empty for all of it, as it stands.
    also : tuple of str
        Further prims it has parts of.
    reference : int or None
        The frame its parts were told apart in.
    """

    animation: MeshAnimation
    part: str = ""
    also: tuple[str, ...] = ()
    reference: int | None = None

    @cached_property
    def lengths(self) -> EdgeLengths:
        """By which its reference frame is chosen, the same for all that is asked of it."""
        return EdgeLengths(self.animation)

    @property
    def name(self) -> str:
        """What a person may call it."""
        prims = " + ".join((self.animation.prim, *self.also))
        return f"{prims} ({self.part})" if self.part else prims


def candidates(asset: Asset) -> list[Candidate]:
    """List what may have been marked by itself; every one of them is to be paid for.

    Each mesh as it stands; where borders lie so near to each other that they must have been cut
    apart, what they are if they are sewn together again, across meshes too; and where there are
    several surfaces of `FEWEST_VERTICES` or more, each of them, and, of the largest, runs of
    them in the order of their faces: a program that joins meshes keeps each of them together.

    Where frames do not agree with each other, those that do are tried by themselves.

    Frames that cannot be read, and meshes of which none can be, are no reason to stop here.
    """
    found = [Candidate(mesh) for mesh in asset.meshes]
    known: list[_Body] = []
    for whole_mesh in tuple(found):
        bodies = _bodies(whole_mesh)
        known += bodies
        if len(bodies) > 1:
            found += [Candidate(body.mesh, body.part, reference=body.reference) for body in bodies]
    for group in _cut_apart(known):
        known = [body for body in known if body not in group]
        whole = _Joined.of(group)
        found.append(whole.candidate(np.arange(len(whole.faces)), "sewn together"))
        found += _surfaces(whole)
    for body in known:
        found += _surfaces(_Joined.of([body])) if body.tracked else _ranked(body)
    return found


@dataclass(frozen=True, eq=False)
class _Body:
    """A mesh in its reference frame.

    Parameters
    ----------
    mesh : MeshAnimation
        The mesh, or some of its frames.
    reference : int
        The frame.
    frame : Frame
        What it shows.
    welding : Welding
        How its points map to the vertices that are analysed.
    part : str
        Which frames they are; empty for all.
    """

    mesh: MeshAnimation
    reference: int
    frame: Frame
    welding: Welding
    part: str = ""

    @classmethod
    def of(cls, mesh: MeshAnimation, part: str, lengths: EdgeLengths) -> _Body:
        """Look at a mesh."""
        reference = lengths.reference(range(len(mesh)))
        frame = readable(mesh, reference)
        return cls(mesh, reference, frame, Welding.of(frame), part)

    @property
    def tracked(self) -> bool:
        """Whether vertices keep their identity over time."""
        return self.mesh.constant_topology

    @cached_property
    def vertices(self) -> FloatArray:
        """Welded vertices, (M, 3)."""
        return self.frame.points[self.welding.kept]

    @property
    def faces(self) -> IntArray:
        """Triangles over them, (F, 3)."""
        return self.welding.topology.triangles


def _bodies(candidate: Candidate) -> list[_Body]:
    """Look at a mesh, and where its frames do not agree, at each group that does."""
    mesh = candidate.animation
    try:
        apart = candidate.lengths.groups()
        if len(apart) == 1:
            return [_Body.of(mesh, "", candidate.lengths)]
        times = [f"{mesh.times[group[0]]:g}" for group in apart]
        return [
            _Body.of(some, f"{len(some)} frames like frame {time}", EdgeLengths(some))
            for some, time in zip(map(mesh.select, apart), times, strict=True)
        ]
    except (InputError, CapacityError):
        # Whatever cannot be looked at is no candidate beside the mesh itself.
        return []


@dataclass(frozen=True)
class PartFrames:
    """Some points of the frames of one or several meshes, under triangles of their own.

    Parameters
    ----------
    sources : tuple of FrameSource
        The meshes, which share their times.
    sizes : tuple of int
        How many points each has.
    kept : (n,) int
        The points wanted, those of all meshes counted through.
    topology : Topology
        Triangles over them.
    """

    sources: tuple[FrameSource, ...]
    sizes: tuple[int, ...]
    kept: IntArray
    topology: Topology

    def frame(self, index: int) -> Frame:
        """Read frame `index` of every mesh, and keep what is wanted.

        Raises
        ------
        InputError
            If one cannot be read, or has another number of points.
        """
        frames = [source.frame(index) for source in self.sources]
        if tuple(len(frame.points) for frame in frames) != self.sizes:
            raise InputError("the number of points changes over time")
        points = np.concatenate([frame.points for frame in frames])
        return Frame(frames[0].time, points[self.kept], self.topology)


@dataclass(frozen=True, eq=False)
class _Joined:
    """Meshes that share their times, as one mesh; what was cut apart is sewn together.

    Parameters
    ----------
    bodies : sequence of _Body
        The meshes.
    points : (M,) int
        Point of the meshes, counted through, that stands for each vertex.
    V : (M, 3) float64
        Vertices in the reference frame.
    faces : (F, 3) int
        Triangles over them.
    """

    bodies: Sequence[_Body]
    points: IntArray
    V: FloatArray
    faces: IntArray

    @classmethod
    def of(cls, bodies: Sequence[_Body]) -> _Joined:
        """Join meshes, and sew what lies together."""
        points, V, F = _concatenated(bodies)
        pairs = seams(V, F)
        if len(pairs) >= FEWEST_SEWN:
            F = sewn(len(V), pairs)[F]
            proper = (F[:, 0] != F[:, 1]) & (F[:, 1] != F[:, 2]) & (F[:, 2] != F[:, 0])
            F = F[proper]
        return cls(bodies, points, V, F)

    @cached_property
    def label(self) -> IntArray:
        """Surface of each triangle, (F,)."""
        return surface_components(self.V, self.faces)

    def candidate(self, chosen: IntArray, part: str) -> Candidate:
        """Make a candidate of some triangles."""
        part = ", ".join(filter(None, (part, self.bodies[0].part)))
        used, local = np.unique(self.faces[chosen], return_inverse=True)
        first, *others = (body.mesh for body in self.bodies)
        frames = PartFrames(
            sources=tuple(body.mesh.source for body in self.bodies),
            sizes=tuple(len(body.frame.points) for body in self.bodies),
            kept=self.points[used],
            topology=Topology.from_triangles(local.reshape(-1, 3), len(used)),
        )
        return Candidate(
            animation=replace(first, source=frames),
            part=part,
            also=tuple(mesh.prim for mesh in others),
            reference=self.bodies[0].reference,
        )


def _concatenated(bodies: Sequence[_Body]) -> tuple[IntArray, FloatArray, IntArray]:
    """List vertices and triangles of meshes one after the other, as `_Joined` has them."""
    points, V, F = [], [], []
    n_points = n_vertices = 0
    for body in bodies:
        points.append(body.welding.kept + n_points)
        V.append(body.vertices)
        F.append(body.faces + n_vertices)
        n_points += len(body.frame.points)
        n_vertices += len(body.vertices)
    return np.concatenate(points), np.concatenate(V), np.concatenate(F)


def _cut_apart(bodies: Sequence[_Body]) -> Iterator[list[_Body]]:
    """Find meshes that were cut apart: each into several, or several that share their times."""
    clocks: dict[tuple[bytes, int], list[_Body]] = {}
    for body in bodies:
        if body.tracked:
            clock = (body.mesh.times.tobytes(), body.reference)
            clocks.setdefault(clock, []).append(body)
    for together in clocks.values():
        _, V, F = _concatenated(together)
        pairs = seams(V, F)
        if len(pairs) < FEWEST_SEWN:
            continue
        owner = np.repeat(np.arange(len(together)), [len(body.vertices) for body in together])
        group = sewn(len(together), owner[pairs])
        for first in np.unique(group[owner[pairs]]):
            yield [together[i] for i in np.flatnonzero(group == first)]


def _surfaces(whole: _Joined) -> list[Candidate]:
    """List the surfaces of a mesh that are large enough, and runs of them; none if there is one."""
    large = _large(whole.V, whole.faces, whole.label)
    if not large:
        return []
    named = {surface: f"surface {number}" for number, surface in enumerate(large, start=1)}
    found = [
        whole.candidate(np.flatnonzero(whole.label == surface), name)
        for surface, name in named.items()
    ]
    for run in _runs(sorted(large[:MOST_IN_RUNS])):
        name = "surfaces " + ", ".join(named[surface].split()[1] for surface in run)
        found.append(whole.candidate(np.flatnonzero(np.isin(whole.label, run)), name))
    return found


def _large(V: FloatArray, F: IntArray, label: IntArray) -> list[int]:
    """List the surfaces to try, the ones of the most vertices first; none if one is all but all."""
    areas, faces = np.bincount(label, face_areas(V, F)), np.bincount(label)
    is_all = areas.max() >= (1.0 - NEGLIGIBLE) * areas.sum() and areas.argmax() == faces.argmax()
    # A small sheet that is attached changes what the large surface is connected like.
    if is_all and face_components(F).max() == label.max():
        return []
    # Triangles of a closed surface are twice as many as its vertices.
    order = np.argsort(-faces, kind="stable")[:MOST_SURFACES]
    return [int(surface) for surface in order if faces[surface] >= 2 * FEWEST_VERTICES]


def _runs(surfaces: Sequence[int]) -> Iterator[Sequence[int]]:
    """List runs of neighbours, longer than one and shorter than all."""
    n = len(surfaces)
    for length in range(2, n):
        for begin in range(n - length + 1):
            yield surfaces[begin : begin + length]


def _ranked(body: _Body) -> list[Candidate]:
    """List the surfaces of a mesh whose connectivity changes: in each frame, the n-th largest."""
    large = _large(body.vertices, body.faces, surface_components(body.vertices, body.faces))
    return [
        Candidate(
            body.mesh.map(partial(_nth_surface, rank=rank)),
            f"surface {rank + 1}",
            reference=body.reference,
        )
        for rank in range(len(large))
    ]


def _nth_surface(frame: Frame, rank: int) -> Frame:
    """Keep the surface of a frame that has the `rank`-th most triangles.

    Raises
    ------
    CapacityError
        If there are fewer.
    """
    welding = Welding.of(frame)
    welded = welding.frame(frame)
    label = surface_components(welded.points, welded.faces)
    counts = np.bincount(label)
    if rank >= len(counts):
        raise CapacityError(f"there are {len(counts)} surfaces only", time=frame.time)
    surface = int(np.argsort(-counts, kind="stable")[rank])
    used, local = np.unique(welded.faces[label == surface], return_inverse=True)
    topology = Topology.from_triangles(local.reshape(-1, 3), len(used))
    return Frame(frame.time, welded.points[used], topology)
