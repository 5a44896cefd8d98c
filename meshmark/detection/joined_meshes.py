"""Meshes that were cut apart, put together again: as one mesh that is read from the others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.detection.reference_frame import EdgeLengths, readable
from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation
from meshmark.mesh.components import seams, sewn, surface_components
from meshmark.mesh.topology import Topology
from meshmark.mesh.welding import Welding

# A cut has at least so many points on either side; fewer are some hole that nearly closed.
FEWEST_SEWN = 12


@dataclass(frozen=True, eq=False)
class Body:
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
    def of(cls, mesh: MeshAnimation, part: str, lengths: EdgeLengths) -> Body:
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
class JoinedMesh:
    """Meshes that share their times, as one mesh; what was cut apart is sewn together.

    Parameters
    ----------
    bodies : sequence of Body
        The meshes.
    points : (M,) int
        Point of the meshes, counted through, that stands for each vertex.
    V : (M, 3) float64
        Vertices in the reference frame.
    faces : (F, 3) int
        Triangles over them.
    """

    bodies: Sequence[Body]
    points: IntArray
    V: FloatArray
    faces: IntArray

    @classmethod
    def of(cls, bodies: Sequence[Body]) -> JoinedMesh:
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

    @property
    def prims(self) -> tuple[str, ...]:
        """The meshes it is made of."""
        return tuple(body.mesh.prim for body in self.bodies)

    @property
    def part(self) -> str:
        """Which of their frames they are; empty for all."""
        return self.bodies[0].part

    @property
    def reference(self) -> int:
        """The frame in which it was put together."""
        return self.bodies[0].reference

    def cut_out(self, chosen: IntArray) -> MeshAnimation:
        """Return the animation of some triangles, named after the first mesh."""
        used, local = np.unique(self.faces[chosen], return_inverse=True)
        frames = PartFrames(
            sources=tuple(body.mesh.source for body in self.bodies),
            sizes=tuple(len(body.frame.points) for body in self.bodies),
            kept=self.points[used],
            topology=Topology.from_triangles(local.reshape(-1, 3), len(used)),
        )
        return replace(self.bodies[0].mesh, source=frames)


def _concatenated(bodies: Sequence[Body]) -> tuple[IntArray, FloatArray, IntArray]:
    """List vertices and triangles of meshes one after the other, as `JoinedMesh` has them."""
    if len(bodies) == 1:
        # Its own triangles: what follows from them is remembered.
        return bodies[0].welding.kept, bodies[0].vertices, bodies[0].faces
    points, V, F = [], [], []
    n_points = n_vertices = 0
    for body in bodies:
        points.append(body.welding.kept + n_points)
        V.append(body.vertices)
        F.append(body.faces + n_vertices)
        n_points += len(body.frame.points)
        n_vertices += len(body.vertices)
    return np.concatenate(points), np.concatenate(V), np.concatenate(F)


def cut_apart(bodies: Sequence[Body]) -> Iterator[list[Body]]:
    """Find meshes that were cut apart: each into several, or several that share their times."""
    clocks: dict[tuple[bytes, int], list[Body]] = {}
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
