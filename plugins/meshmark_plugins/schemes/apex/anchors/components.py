"""The connected components of a mesh that are large enough to carry anything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import face_areas
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
    label = face_components(F) if label is None else label
    areas = np.bincount(label, face_areas(V, F))
    large = np.flatnonzero(areas >= MIN_COMPONENT_AREA_SHARE * areas.sum())
    first = np.array([int(np.argmax(label == number)) for number in large])
    ordered = large[np.lexsort((first, -areas[large]))]
    return [_component(F[label == number]) for number in ordered]


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


def _component(F: IntArray) -> Component:
    vertices, local = np.unique(F, return_inverse=True)
    return Component(vertices, local.reshape(-1, 3))
