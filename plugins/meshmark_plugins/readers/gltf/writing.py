"""Writes a marked copy of a glTF file: the same file with other positions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark_plugins.readers.gltf.container import Container
from meshmark_plugins.readers.gltf.draft import Draft
from meshmark_plugins.readers.gltf.frames import GltfFrames
from meshmark_plugins.readers.gltf.output import write_document
from meshmark_plugins.readers.gltf.places import find_places

# Share of a sum of squares below which a direction does not show in any frame.
UNSEEN = 1e-12

MarkedFrames = tuple[GltfFrames, MeshAnimation]


def write_marked(
    source: Path, container: Container, meshes: Sequence[MarkedFrames], output: Path
) -> None:
    """Write a file with the positions that come nearest to marked frames.

    A file has one position at rest for each vertex, and all frames follow from it. Written is the
    one whose frames deviate least from the marked ones, in the mean square. Where several nodes
    use a mesh, all of them count.

    Parameters
    ----------
    source : Path
    container : Container
        What it holds.
    meshes : sequence of (GltfFrames, MeshAnimation)
        Each as it is in the source, and as it was marked.
    output : Path

    Raises
    ------
    UsageError
        If positions cannot be replaced where they stand, or a frame is not one of the source.
    OutputError
        If it cannot be written, or a position is beyond what float32 holds.
    """
    places = find_places(container, source.parent)
    draft = Draft(container, source.parent)
    for accessor, move in _moves(meshes).items():
        draft.root["accessors"][accessor] |= places[accessor].move(draft, move, output)
    write_document(container, draft.root, draft.data(), source.parent, output)


def _moves(meshes: Sequence[MarkedFrames]) -> dict[int, FloatArray]:
    """Return how far each position is to move, (N, 3) of each accessor."""
    sums: dict[int, tuple[FloatArray, FloatArray]] = {}
    for plain, marked in meshes:
        AtA, Atd = _normal_equations(plain, marked)
        begins = [begin for _, begin in plain.geometry.positions]
        ends = [*begins[1:], len(Atd)]
        for (accessor, begin), end in zip(plain.geometry.positions, ends, strict=True):
            before = sums.get(accessor, (0.0, 0.0))
            sums[accessor] = before[0] + AtA[begin:end], before[1] + Atd[begin:end]
    return {accessor: _solved(*both) for accessor, both in sums.items()}


def _normal_equations(plain: GltfFrames, marked: MeshAnimation) -> tuple[FloatArray, FloatArray]:
    """Sum up, over the frames that were marked, what a least squares fit needs."""
    n = plain.geometry.topology.n_points
    AtA, Atd = np.zeros((n, 3, 3)), np.zeros((n, 3))
    # NaN, the time of what does not move, is not equal to itself; its name is.
    known = {repr(float(code)): index for index, code in enumerate(plain.timeline.codes)}
    for frame in marked:
        index = known.get(repr(float(frame.time)))
        if index is None or len(frame.points) != n:
            raise UsageError(
                "the marked copy has other vertices or times than the source",
                source=plain.source,
                prim=plain.prim,
            )
        moved = frame.points - plain.frame(index).points
        # Frames that stayed as they are say nothing about where the others went.
        if moved.any():
            At = plain.derivative(index).transpose(0, 2, 1)
            AtA += At @ At.transpose(0, 2, 1)
            Atd += (At @ moved[:, :, None])[:, :, 0]
    return AtA, Atd


def _solved(AtA: FloatArray, Atd: FloatArray) -> FloatArray:
    trace = np.trace(AtA, axis1=1, axis2=2)
    # What no frame shows, as of a mesh that is scaled flat, stays where it is.
    ridge = np.where(trace > 0, UNSEEN * trace, 1.0)
    moves = np.linalg.solve(AtA + ridge[:, None, None] * np.eye(3), Atd[:, :, None])
    return moves[:, :, 0].astype(np.float64, copy=False)
