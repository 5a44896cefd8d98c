"""What may have been marked by itself: meshes, the surfaces in them, meshes that were cut apart.

A copy can have a ground, a box or a second body joined to its mesh, a sheet attached to it, or
be cut into several meshes. What was marked is then one surface, or some, of what is found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.detection.joined_meshes import Body, JoinedMesh, cut_apart
from meshmark.detection.reference_frame import EdgeLengths
from meshmark.errors import CapacityError, InputError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.components import surface_components
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.runs import cut, longest, runs, span
from meshmark.mesh.topology import Topology, face_components
from meshmark.mesh.welding import Welding

# A surface of fewer vertices holds no mark by itself.
FEWEST_VERTICES = 500
# Most surfaces of a mesh that are tried each by itself, the ones of the most vertices first; and
# among how many of them runs of neighbours are tried together.
MOST_SURFACES, MOST_IN_RUNS = 64, 5
# Most runs of frames of a mesh whose connectivity changes that are tried each by itself.
MOST_RUNS = 12
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
        The frame in which its parts were separated.
    """

    animation: MeshAnimation
    part: str = ""
    also: tuple[str, ...] = ()
    reference: int | None = None

    @cached_property
    def lengths(self) -> EdgeLengths:
        """By which its reference frame is chosen, shared by all schemes and looks."""
        return EdgeLengths(self.animation)

    @property
    def name(self) -> str:
        """What a person may call it."""
        prims = " + ".join((self.animation.prim, *self.also))
        return f"{prims} ({self.part})" if self.part else prims


def candidates(asset: Asset) -> list[Candidate]:
    """List what may have been marked by itself; verdicts are corrected for their number.

    Each mesh as it stands; where borders lie so near to each other that they must have been cut
    apart, what they are if they are sewn together again, across meshes too; and where there are
    several surfaces of `FEWEST_VERTICES` or more, each of them, and, of the largest, runs of
    them in the order of their faces: a program that joins meshes keeps each of them together.

    Where frames do not agree with each other, those that do are tried by themselves; and where
    the connectivity changes, the longest runs of frames in which it does not.

    Frames that cannot be read, and meshes of which none can be, are no reason to stop here.
    """
    whole = [Candidate(mesh) for mesh in asset.meshes]
    wanted = [*whole, *(run for mesh in asset.meshes for run in _runs_of(mesh))]
    known: list[Body] = []
    for whole_mesh in whole:
        bodies = _bodies(whole_mesh)
        known += bodies
        if len(bodies) > 1:
            wanted += [Candidate(body.mesh, body.part, reference=body.reference) for body in bodies]
    for group in cut_apart(known):
        known = [body for body in known if body not in group]
        sewn = JoinedMesh.of(group)
        wanted.append(_part_of(sewn, np.arange(len(sewn.faces)), "sewn together"))
        wanted += _surfaces(sewn)
    for body in known:
        wanted += _surfaces(JoinedMesh.of([body])) if body.tracked else _ranked(body)
    return wanted


def whole_meshes(asset: Asset) -> list[Candidate]:
    """List each mesh as it stands, and runs of frames as they may have been marked."""
    return [candidate for mesh in asset.meshes for candidate in (Candidate(mesh), *_runs_of(mesh))]


def _runs_of(mesh: MeshAnimation) -> list[Candidate]:
    """List the longest runs of frames of a mesh whose connectivity changes; not single frames."""
    if mesh.constant_topology:
        return []
    long = [run for run in runs(mesh) if len(run) > 1]
    parts = [cut(mesh, run) for run in (longest(long, MOST_RUNS) if long else [])]
    return [Candidate(part, f"frames {span(part)}") for part in parts]


def _bodies(candidate: Candidate) -> list[Body]:
    """Look at a mesh, and where its frames do not agree, at each group that does."""
    mesh = candidate.animation
    try:
        apart = candidate.lengths.groups()
        if len(apart) == 1:
            return [Body.of(mesh, "", candidate.lengths)]
        times = [f"{mesh.times[group[0]]:g}" for group in apart]
        return [
            Body.of(some, f"{len(some)} frames like frame {time}", EdgeLengths(some))
            for some, time in zip(map(mesh.select, apart), times, strict=True)
        ]
    except (InputError, CapacityError):
        # Whatever cannot be looked at is no candidate beside the mesh itself.
        return []


def _part_of(whole: JoinedMesh, chosen: IntArray, part: str) -> Candidate:
    """Make a candidate of some triangles."""
    return Candidate(
        animation=whole.cut_out(chosen),
        part=", ".join(filter(None, (part, whole.part))),
        also=whole.prims[1:],
        reference=whole.reference,
    )


def _surfaces(whole: JoinedMesh) -> list[Candidate]:
    """List the surfaces of a mesh that are large enough, and runs of them; none if there is one."""
    large = _large(whole.V, whole.faces, whole.label)
    if not large:
        return []
    named = {surface: f"surface {number}" for number, surface in enumerate(large, start=1)}
    found = [
        _part_of(whole, np.flatnonzero(whole.label == surface), name)
        for surface, name in named.items()
    ]
    for run in _runs(sorted(large[:MOST_IN_RUNS])):
        name = "surfaces " + ", ".join(named[surface].split()[1] for surface in run)
        found.append(_part_of(whole, np.flatnonzero(np.isin(whole.label, run)), name))
    return found


def _large(V: FloatArray, F: IntArray, label: IntArray) -> list[int]:
    """List the surfaces to try, the ones of the most vertices first; none if one is all but all."""
    areas, faces = np.bincount(label, face_areas(V, F)), np.bincount(label)
    is_all = areas.max() >= (1.0 - NEGLIGIBLE) * areas.sum() and areas.argmax() == faces.argmax()
    # A small sheet that is attached changes what the large surface is connected like.
    if is_all and (label.max() == 0 or face_components(F).max() == label.max()):
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


def _ranked(body: Body) -> list[Candidate]:
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
