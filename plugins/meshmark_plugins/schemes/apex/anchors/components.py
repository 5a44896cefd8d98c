"""The connected pieces of a mesh that are large enough to carry anything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.topology import boundary_edges, face_components

# Smaller pieces (eyes, buttons) have no tips of their own worth marking.
LEAST_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class Piece:
    """An edge-connected piece of a mesh.

    Parameters
    ----------
    vertices : (n,) int
        Its vertices, indices into the mesh.
    faces : (f, 3) int
        Its triangles, indices into `vertices`.
    """

    vertices: IntArray
    faces: IntArray


def split(V: FloatArray, F: IntArray, label: IntArray | None = None) -> list[Piece]:
    """Split a mesh into its connected pieces of at least `LEAST_SHARE` of the area.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    label : (F,) int, optional
        Its edge-connected components, where they are known.

    Returns
    -------
    list of Piece
        The largest first; of equal ones, the one whose first triangle comes first.
    """
    label = face_components(F) if label is None else label
    areas = np.bincount(label, face_areas(V, F))
    large = np.flatnonzero(areas >= LEAST_SHARE * areas.sum())
    first = np.array([int(np.argmax(label == component)) for component in large])
    ordered = large[np.lexsort((first, -areas[large]))]
    return [_piece(F[label == component]) for component in ordered]


def reference_lengths(V: FloatArray, pieces: list[Piece]) -> list[float]:
    """Tell in which length each piece of a mesh is measured.

    The largest piece, and all that have a border, are measured in the square root of their area
    together: they may have been one before a cut. Others are closed, and measured in their own.
    """
    areas = [float(face_areas(V[piece.vertices], piece.faces).sum()) for piece in pieces]
    joined = [i == 0 or boundary_edges(piece.faces).size > 0 for i, piece in enumerate(pieces)]
    shared = sum(area for area, is_joined in zip(areas, joined, strict=True) if is_joined)
    return [
        float(np.sqrt(shared if is_joined else area))
        for area, is_joined in zip(areas, joined, strict=True)
    ]


def shared_length(V: FloatArray, F: IntArray) -> float:
    """Length in which the largest piece of a mesh is measured."""
    return reference_lengths(V, split(V, F))[0]


def _piece(F: IntArray) -> Piece:
    vertices, local = np.unique(F, return_inverse=True)
    return Piece(vertices, local.reshape(-1, 3))
