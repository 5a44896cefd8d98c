"""Meshes of a copy, taken apart where several were joined into one; originals, joined into one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from meshmark.arrays import IntArray
from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation
from meshmark.mesh.components import surface_components
from meshmark.mesh.topology import Topology, weld

# Surfaces that a mesh is taken apart into at most; the smaller ones stay together.
MOST_PIECES = 64


def pieces(mesh: MeshAnimation, sizes: Sequence[tuple[int, int]]) -> list[MeshAnimation]:
    """Take a mesh apart, the largest piece first; itself if there is nothing to take apart.

    Parameters
    ----------
    mesh : MeshAnimation
        Of a copy.
    sizes : sequence of (int, int)
        Points and triangles of each mesh that may have been joined.

    Notes
    -----
    Programs that join meshes keep the vertices of each together. So a run of vertices that no
    face connects with others, of the size of a mesh of the original, is that mesh, and its
    vertices keep their identity. Of the rest, each connected surface is a piece.
    """
    try:
        frame = mesh[0]
    except InputError:
        return [mesh]
    F, n = frame.faces, frame.topology.n_points
    if not mesh.constant_topology or (n, len(F)) in sizes:
        return [mesh]
    runs = _runs(F, n, sizes)
    whole = np.full(n, -1)
    for label, (begin, end) in enumerate(runs):
        whole[begin:end] = label
    of_face = whole[F[:, 0]]
    rest = np.flatnonzero(of_face < 0)
    found = [_piece(mesh, F[of_face == label], run) for label, run in enumerate(runs)]
    if rest.size:
        V, welded, _ = weld(frame.points, F[rest])
        surface = surface_components(V, welded)
        order = np.argsort(-np.bincount(surface), kind="stable")
        rank = np.minimum(np.argsort(order), MOST_PIECES - 1)[surface]
        found += [_piece(mesh, F[rest[rank == each]]) for each in np.unique(rank)]
    if len(found) == 1:
        return [mesh]
    return sorted(found, key=lambda piece: -piece[0].topology.n_points)


def joined(meshes: Sequence[MeshAnimation]) -> MeshAnimation | None:
    """Return several meshes of constant topology as one; None if their times differ."""
    first = meshes[0]
    if not all(
        mesh.constant_topology and np.array_equal(mesh.times, first.times, equal_nan=True)
        for mesh in meshes
    ):
        return None
    counts = [mesh[0].topology.n_points for mesh in meshes]
    shifts = np.cumsum([0, *counts[:-1]])
    F = np.concatenate([mesh[0].faces + shift for mesh, shift in zip(meshes, shifts, strict=True)])
    topology = Topology.from_triangles(F, sum(counts))
    return replace(first, source=JoinedFrames(tuple(mesh.source for mesh in meshes), topology))


@dataclass(frozen=True)
class JoinedFrames:
    """Frames of several meshes that share their times, as those of one mesh."""

    sources: tuple[FrameSource, ...]
    topology: Topology

    def frame(self, index: int) -> Frame:
        """Read frame `index` of all."""
        frames = [source.frame(index) for source in self.sources]
        return Frame(
            frames[0].time, np.concatenate([frame.points for frame in frames]), self.topology
        )


def _runs(F: IntArray, n: int, sizes: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    """Find a run of vertices (begin, end) for each size that has one; no two overlap."""
    low, high = F.min(axis=1), F.max(axis=1)
    open_faces = np.cumsum(np.bincount(low, minlength=n + 1) - np.bincount(high, minlength=n + 1))
    # Between two vertices where no face is open, a run may end.
    ends = np.concatenate([[0], np.flatnonzero(open_faces[: n - 1] == 0) + 1, [n]])
    faces_before = np.concatenate([[0], np.cumsum(np.bincount(low, minlength=n))])
    free = np.ones(n + 1, dtype=np.int64)
    found = []
    # A small mesh may be of the size of a part of a large one.
    for points, triangles in sorted(sizes, reverse=True):
        taken_before = np.concatenate([[0], np.cumsum(1 - free)])
        begins = ends[np.isin(ends + points, ends)]
        fits = faces_before[begins + points] - faces_before[begins] == triangles
        fits &= taken_before[begins + points] == taken_before[begins]
        if fits.any():
            begin = int(begins[fits][0])
            free[begin : begin + points] = 0
            found.append((begin, begin + points))
    return found


def _piece(mesh: MeshAnimation, F: IntArray, run: tuple[int, int] | None = None) -> MeshAnimation:
    """Keep some triangles, and the points they use, or all of a run."""
    kept, corners = np.unique(F, return_inverse=True)
    corners = corners.reshape(-1, 3)
    if run is not None:
        kept, corners = np.arange(*run), F - run[0]
    topology = Topology.from_triangles(corners, len(kept))
    return mesh.map(partial(_kept, kept=kept, topology=topology))


def _kept(frame: Frame, kept: IntArray, topology: Topology) -> Frame:
    return Frame(frame.time, frame.points[kept], topology)
