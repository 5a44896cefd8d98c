"""Writes a marked copy of a glTF file: the same file with other positions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark_plugins.readers.gltf.container import Container
from meshmark_plugins.readers.gltf.draft import Draft
from meshmark_plugins.readers.gltf.following import followed
from meshmark_plugins.readers.gltf.frames import GltfFrames
from meshmark_plugins.readers.gltf.geometry import Geometry
from meshmark_plugins.readers.gltf.output import write_document
from meshmark_plugins.readers.gltf.places import Place, find_places, find_target_places

# Share of a sum of squares below which a direction does not show in any frame.
UNSEEN = 1e-12

MarkedFrames = tuple[GltfFrames, MeshAnimation]


def write_marked(
    source: Path, container: Container, meshes: Sequence[MarkedFrames], output: Path
) -> None:
    """Write a file with the positions that come nearest to marked frames.

    A file has one position at rest for each vertex, and all frames follow from it. Written is the
    one whose frames deviate least from the marked ones, in the mean square. Where several nodes
    use a mesh, all of them count. Morph targets of vertices that slid become those of their new
    places, where they can be replaced, and if the frames come nearer then.

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
    fit = _fit(meshes)
    if any(plain.geometry.vertices.targets for plain, _ in meshes):
        targets = find_target_places(container, source.parent)
        places |= targets
        fit = min(fit, _fit_followed(meshes, fit.moves, targets), key=lambda each: each.off)
    for accessor, move in (fit.moves | fit.changes).items():
        draft.root["accessors"][accessor] |= places[accessor].move(draft, move, output)
    write_document(container, draft.root, draft.data(), source.parent, output)


@dataclass(frozen=True)
class _Fit:
    """Positions whose frames come nearest to marked ones.

    Parameters
    ----------
    moves, changes : dict of int to (n, 3) float64
        How far the positions, and the morph targets, of accessors move.
    off : float
        How far the frames still are from the marked ones: the sum of squares.
    """

    moves: dict[int, FloatArray]
    off: float
    changes: dict[int, FloatArray] = field(default_factory=dict)


def _fit_followed(
    meshes: Sequence[MarkedFrames], moves: dict[int, FloatArray], targets: Mapping[int, Place]
) -> _Fit:
    """Let morph targets follow positions that move, and fit these anew."""
    geometries = {id(plain.geometry): plain.geometry for plain, _ in meshes}
    after = {key: followed(each, moves, targets) for key, each in geometries.items()}
    fit = _fit(meshes, {key: each.geometry for key, each in after.items()})
    changes = {key: each for one in after.values() for key, each in one.changes.items()}
    return replace(fit, changes=changes)


def _fit(meshes: Sequence[MarkedFrames], others: Mapping[int, Geometry] | None = None) -> _Fit:
    """Fit the positions of each accessor.

    Parameters
    ----------
    others : mapping of int to Geometry, optional
        What geometries, by their identity, have become.
    """
    sums: dict[int, tuple[FloatArray, FloatArray]] = {}
    off = 0.0
    for plain, marked in meshes:
        geometry = plain.geometry if others is None else others[id(plain.geometry)]
        AtA, Atd, squares = _normal_equations(plain, marked, geometry)
        off += squares
        begins = [begin for _, begin in plain.geometry.positions]
        ends = [*begins[1:], len(Atd)]
        for (accessor, begin), end in zip(plain.geometry.positions, ends, strict=True):
            before = sums.get(accessor, (0.0, 0.0))
            sums[accessor] = before[0] + AtA[begin:end], before[1] + Atd[begin:end]
    moves = {accessor: _solved(*both) for accessor, both in sums.items()}
    for accessor, (AtA, Atd) in sums.items():
        move = moves[accessor]
        # |A m - d|^2, without the frames.
        off += float(np.sum(move * (np.einsum("nij,nj->ni", AtA, move) - 2 * Atd)))
    return _Fit(moves, off)


def _normal_equations(
    plain: GltfFrames, marked: MeshAnimation, geometry: Geometry
) -> tuple[FloatArray, FloatArray, float]:
    """Sum up, over the frames that were marked, what a least squares fit of a geometry needs.

    These are A^T A (N, 3, 3), A^T d (N, 3) and |d|^2, for moves d of frames.
    """
    n = plain.geometry.topology.n_points
    AtA, Atd, squares = np.zeros((n, 3, 3)), np.zeros((n, 3)), 0.0
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
        before = plain.frame(index).points
        # Frames that stayed as they are say nothing about where the others went.
        if np.any(frame.points != before):
            if geometry is not plain.geometry:
                before = replace(plain, geometry=geometry).frame(index).points
            moved = frame.points - before
            At = plain.derivative(index).transpose(0, 2, 1)
            AtA += At @ At.transpose(0, 2, 1)
            Atd += (At @ moved[:, :, None])[:, :, 0]
            squares += float(np.sum(moved**2))
    return AtA, Atd, squares


def _solved(AtA: FloatArray, Atd: FloatArray) -> FloatArray:
    trace = np.trace(AtA, axis1=1, axis2=2)
    # What no frame shows, as of a mesh that is scaled flat, stays where it is.
    ridge = np.where(trace > 0, UNSEEN * trace, 1.0)
    moves = np.linalg.solve(AtA + ridge[:, None, None] * np.eye(3), Atd[:, :, None])
    return moves[:, :, 0].astype(np.float64, copy=False)
