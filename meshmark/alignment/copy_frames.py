"""Frames of a copy that may consist of several meshes, as alignment reads them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.checks import require_extent, require_measurable
from meshmark.mesh.components import surface_components
from meshmark.mesh.geometry import face_areas, vertex_normals
from meshmark.mesh.topology import weld


@dataclass(frozen=True, eq=False)
class CopyFrame:
    """One frame of a copy.

    Parameters
    ----------
    points, normals : (n, 3) float64
        Vertices that faces use, and the unit normals there.
    faces : (F, 3) int
        Triangles over these vertices.
    vertices : (n,) int
        Which of the meshes' vertices they are, one mesh after the other.
    n_points : int
        How many the meshes have, used or not.
    """

    points: FloatArray
    normals: FloatArray
    faces: IntArray
    vertices: IntArray
    n_points: int

    @classmethod
    def of(cls, meshes: Sequence[MeshAnimation], index: int) -> CopyFrame:
        """Read frame `index` of the first mesh, and of the others what they show at its time.

        Raises
        ------
        InputError
            If points are not finite, or the surface has no area.
        """
        time = meshes[0].times[index]
        points, faces, n = [], [], 0
        for mesh in meshes:
            frame = mesh[_at(mesh, float(time), index)]
            require_measurable(frame.points)
            points.append(frame.points)
            faces.append(frame.faces + n)
            n += len(frame.points)
        V, F = np.concatenate(points), np.concatenate(faces)
        require_extent(V, F)
        used, corners = np.unique(F, return_inverse=True)
        F = corners.reshape(-1, 3)
        return cls(V[used], vertex_normals(V[used], F), F, used, len(V))

    def parts(self, most: int) -> list[CopyFrame]:
        """List its connected surfaces, at most so many, the largest first; none if it is one."""
        V, F, _ = weld(self.points, self.faces)
        label = surface_components(V, F)
        areas = np.bincount(label, face_areas(V, F))
        if len(areas) == 1:
            return []
        largest = np.argsort(-areas, kind="stable")[:most]
        return [self._of_faces(self.faces[label == each]) for each in largest]

    def _of_faces(self, faces: IntArray) -> CopyFrame:
        used, corners = np.unique(faces, return_inverse=True)
        return replace(
            self,
            points=self.points[used],
            normals=self.normals[used],
            faces=corners.reshape(-1, 3),
            vertices=self.vertices[used],
        )

    def some(self, most: int) -> CopyFrame:
        """Return it with at most so many of its vertices, spread evenly, and without faces."""
        if len(self.points) <= most:
            return self
        kept = np.linspace(0, len(self.points) - 1, most).round().astype(np.int64)
        return replace(
            self,
            points=self.points[kept],
            normals=self.normals[kept],
            faces=np.empty((0, 3), dtype=np.int64),
            vertices=self.vertices[kept],
        )


def _at(mesh: MeshAnimation, time: float, index: int) -> int:
    if len(mesh) == 1 or np.isnan(time):
        return min(index, len(mesh) - 1)
    return int(np.abs(mesh.times - time).argmin())
