"""The anchors of a component, and the distance of every vertex from each of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.geometry import vertex_areas
from meshmark_plugins.schemes.apex.anchors.components import (
    Component,
    large_components,
    shared_root_areas,
)
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances

# Radius of the geodesic disc about an anchor, in root areas.
DISC_RADIUS = 0.3


@dataclass(frozen=True, eq=False)
class GeodesicField:
    """The anchors of one component of a frame, and the distances from them.

    Parameters
    ----------
    component : Component
        Which vertices and triangles.
    V : (n, 3) float64
        Positions of the component's vertices.
    length_scale : float
        Length in which distances are given: at first the component's root area, see
        `shared_root_areas`.
    reference_root_area : float
        Root area of the largest component of the mesh.
    anchors : (m,) int
        Vertices of the mesh (not of the component).
    persistence : (m,) float64
        Persistence of each anchor, in root areas; 0 where it was given, not detected.
    H : (m, n) float64
        Distance of the component's vertices from each anchor, in length scales.
    """

    component: Component
    V: FloatArray
    length_scale: float
    reference_root_area: float
    anchors: IntArray
    persistence: FloatArray
    H: FloatArray

    def rescaled(self, factor: float) -> GeodesicField:
        """Give the same distances in a length scale that is `factor` times as long."""
        return replace(self, length_scale=self.length_scale * factor, H=self.H / factor)

    @property
    def disc_area_share(self) -> FloatArray:
        """Share of the component's area within `DISC_RADIUS` of each anchor, (m,).

        It tells a nose from a hoof from a tail, and hardly changes as the body moves.
        """
        return self._mean_by_area((self.H < DISC_RADIUS).astype(np.float64))

    @property
    def mean_geodesic_distance(self) -> FloatArray:
        """Mean distance of the component's surface from each anchor, (m,), in length scales."""
        return self._mean_by_area(self.H)

    def _mean_by_area(self, values: FloatArray) -> FloatArray:
        areas = vertex_areas(self.V, self.component.faces)
        return values @ areas / areas.sum()


def geodesic_fields(
    V: FloatArray, F: IntArray, anchors: IntArray, label: IntArray | None = None
) -> list[GeodesicField]:
    """Measure distances from anchors that are known already, component by component.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    anchors : (m,) int
        Vertices.
    label : (F,) int, optional
        Edge-connected component of each triangle, where it is known.

    Raises
    ------
    CapacityError
        If an anchor lies in no large component.
    """
    fields, left = [], len(anchors)
    components = large_components(V, F, label)
    root_areas = shared_root_areas(V, components)
    for component, root_area in zip(components, root_areas, strict=True):
        local = np.full(len(V), -1)
        local[component.vertices] = np.arange(len(component.vertices))
        own = local[anchors][local[anchors] >= 0]
        if own.size:
            points = V[component.vertices]
            fields.append(
                measure_field(
                    component,
                    points,
                    (root_area, root_areas[0]),
                    GeodesicDistances(points, component.faces),
                    own,
                    np.zeros(len(own)),
                )
            )
            left -= len(own)
    if left:
        raise CapacityError("an anchor lies in a piece that is too small in some frame")
    return fields


def measure_field(
    component: Component,
    V: FloatArray,
    root_areas: tuple[float, float],
    geodesics: GeodesicDistances,
    anchors: IntArray,
    persistence: FloatArray,
) -> GeodesicField:
    """Measure distances from anchors (m,), vertices of the component.

    Other parameters are those of `GeodesicField`; `root_areas` are the component's, and that of
    the largest one.
    """
    return GeodesicField(
        component=component,
        V=V,
        length_scale=root_areas[0],
        reference_root_area=root_areas[1],
        anchors=component.vertices[anchors],
        persistence=persistence,
        H=geodesics.from_vertices(anchors) * (geodesics.root_area / root_areas[0]),
    )
