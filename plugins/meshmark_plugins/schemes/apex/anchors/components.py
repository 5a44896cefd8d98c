"""The connected components of a mesh that are large enough to carry anything."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.remembered import read_only, remembered
from meshmark.mesh.topology import boundary_edges, face_components

# Smaller components (eyes, buttons) have no tips of their own worth marking.
MIN_COMPONENT_AREA_SHARE = 0.02


@dataclass(frozen=True, eq=False)
class Component:
    """An edge-connected component of a mesh.

    Parameters
    ----------
    vertices : (n,) int
        Its vertices, indices into the mesh.
    faces : (f, 3) int
        Its triangles, indices into `vertices`.
    """

    vertices: IntArray
    faces: IntArray


def large_components(V: FloatArray, F: IntArray, label: IntArray | None = None) -> list[Component]:
    """Find the components of a mesh that have at least `MIN_COMPONENT_AREA_SHARE` of its area.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    label : (F,) int, optional
        Edge-connected component of each triangle, where it is known.

    Returns
    -------
    list of Component
        The largest first; of equal ones, the one whose first triangle comes first.
    """
    pieces = _pieces(F) if label is None else _Pieces(label)
    areas = np.bincount(pieces.label, face_areas(V, F))
    large = np.flatnonzero(areas >= MIN_COMPONENT_AREA_SHARE * areas.sum())
    first = np.array([int(np.argmax(pieces.label == number)) for number in large])
    ordered = large[np.lexsort((first, -areas[large]))]
    return [pieces.component(number, F) for number in ordered.tolist()]


def shared_root_areas(V: FloatArray, components: list[Component]) -> list[float]:
    """Compute the root area in which each component of a mesh is measured.

    The largest component, and all that have a border, are measured in the square root of their
    area together: a cut may have parted them. Others are closed, and measured in their own.
    """
    areas = [float(face_areas(V[part.vertices], part.faces).sum()) for part in components]
    joined = [i == 0 or boundary_edges(part.faces).size > 0 for i, part in enumerate(components)]
    shared = sum(area for area, is_joined in zip(areas, joined, strict=True) if is_joined)
    return [
        float(np.sqrt(shared if is_joined else area))
        for area, is_joined in zip(areas, joined, strict=True)
    ]


def reference_root_area(V: FloatArray, F: IntArray) -> float:
    """Root area in which the largest component of a mesh is measured."""
    return shared_root_areas(V, large_components(V, F))[0]


@dataclass(frozen=True, eq=False)
class _Pieces:
    """The components of some triangles, each listed when it is asked for, and only once.

    Parameters
    ----------
    label : (F,) int
        Component of each triangle.
    """

    label: IntArray
    _listed: dict[int, Component] = field(default_factory=dict)

    def component(self, number: int, F: IntArray) -> Component:
        """Return the component that the triangles F (F, 3) with this label make up."""
        if number not in self._listed:
            vertices, local = np.unique(F[self.label == number], return_inverse=True)
            self._listed[number] = Component(vertices, read_only(local.reshape(-1, 3)))
        return self._listed[number]


@remembered
def _pieces(F: IntArray) -> _Pieces:
    return _Pieces(face_components(F))
