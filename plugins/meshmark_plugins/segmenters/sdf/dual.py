"""The dual of a mesh: faces as nodes, shared edges as links, lengths without a unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.topology import face_adjacency


@dataclass(frozen=True, eq=False)
class DualGraph:
    """Faces and the edges between them, measured in units of sqrt(area of the mesh).

    Parameters
    ----------
    area : (F,) float64
        Share of each face in the area of the mesh.
    normal : (F, 3) float64
        Unit normals; zero where a face has no area.
    centroid : (F, 3) float64
        Centroids, from the centroid of the surface.
    pairs : (A, 2) int
        Faces that share an edge.
    length : (A,) float64
        Length of the shared edge.
    """

    area: FloatArray
    normal: FloatArray
    centroid: FloatArray
    pairs: IntArray
    length: FloatArray

    @classmethod
    def of(cls, V: FloatArray, F: IntArray) -> DualGraph:
        """Measure the dual of a mesh, V (N, 3) and F (F, 3)."""
        corners, scale = unit_corners(V, F)
        normal, area = normals_and_areas(corners)
        if area.sum() <= 0.0:
            area = np.full(len(F), 1.0 / len(F))
        pairs, shared = face_adjacency(F)
        length = np.linalg.norm(V[shared[:, 1]] - V[shared[:, 0]], axis=1) / scale
        return cls(area, normal, corners.mean(axis=1), pairs, length)

    @property
    def span(self) -> FloatArray:
        """Vector from the first centroid of each pair to the second, (A, 3)."""
        return self.centroid[self.pairs[:, 1]] - self.centroid[self.pairs[:, 0]]


def unit_corners(V: FloatArray, F: IntArray) -> tuple[FloatArray, float]:
    """Move a surface's centroid to the origin and scale it to area 1.

    Returns
    -------
    corners : (F, 3, 3) float64
        Corners of each face.
    scale : float
        Length of the new unit in the old one; 1 for a surface without area.
    """
    corners = V[F]
    _, area = normals_and_areas(corners)
    total = float(area.sum())
    if total <= 0.0:
        return corners - corners.reshape(-1, 3).mean(axis=0), 1.0
    scale = float(np.sqrt(total))
    centre = area @ corners.mean(axis=1) / total
    return (corners - centre) / scale, scale


def normals_and_areas(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute unit normals (F, 3), zero where a face has none, and areas (F,)."""
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    norm = np.linalg.norm(cross, axis=1)
    return cross / np.where(norm > 0.0, norm, 1.0)[:, None], norm / 2.0
