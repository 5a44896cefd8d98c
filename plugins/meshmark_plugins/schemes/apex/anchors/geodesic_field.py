"""The anchors of a component, and the distance of every vertex from each of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.geometry import vertex_areas
from meshmark.mesh.proxy import Proxy
from meshmark_plugins.schemes.apex.anchors.components import (
    Component,
    large_components,
    shared_root_areas,
)
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances
from meshmark_plugins.schemes.apex.anchors.proxies import Proxies
from meshmark_plugins.schemes.apex.anchors.proxy_distances import ProxyDistances

# Radius of the geodesic disc about an anchor, in root areas.
DISC_RADIUS = 0.3


@dataclass(frozen=True, eq=False)
class ProxyField:
    """Distances from the anchors of a component on its proxy.

    Parameters
    ----------
    proxy : Proxy
        Of the component.
    V : (k, 3) float64
        Its positions.
    H : (m, k) float64
        Distance of its vertices from each anchor, in the length scale of the component's.
    """

    proxy: Proxy
    V: FloatArray
    H: FloatArray


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
    on_proxy : ProxyField or None
        The same on the proxy that they were measured on, if they were.
    """

    component: Component
    V: FloatArray
    length_scale: float
    reference_root_area: float
    anchors: IntArray
    persistence: FloatArray
    H: FloatArray
    on_proxy: ProxyField | None = None

    @property
    def surface(self) -> tuple[FloatArray, IntArray, FloatArray]:
        """Positions, triangles and distances of the mesh that areas are summed over."""
        if self.on_proxy is None:
            return self.V, self.component.faces, self.H
        return self.on_proxy.V, self.on_proxy.proxy.faces, self.on_proxy.H

    def rescaled(self, factor: float) -> GeodesicField:
        """Give the same distances in a length scale that is `factor` times as long."""
        on_proxy = self.on_proxy and replace(self.on_proxy, H=self.on_proxy.H / factor)
        length_scale = self.length_scale * factor
        return replace(self, length_scale=length_scale, H=self.H / factor, on_proxy=on_proxy)

    @property
    def disc_area_share(self) -> FloatArray:
        """Share of the component's area within `DISC_RADIUS` of each anchor, (m,).

        It tells a nose from a hoof from a tail, and hardly changes as the body moves.
        """
        V, F, H = self.surface
        return _mean_by_area(V, F, (H < DISC_RADIUS).astype(np.float64))

    @property
    def mean_geodesic_distance(self) -> FloatArray:
        """Mean distance of the component's surface from each anchor, (m,), in length scales."""
        return _mean_by_area(*self.surface)


@dataclass(frozen=True, eq=False)
class AnchoredComponent:
    """A component of a frame, and which of some anchors lie on it.

    Parameters
    ----------
    component : Component
        Which vertices and triangles.
    root_areas : (float, float)
        Root area in which the component is measured, and that of the largest one.
    anchors : (m,) int
        Vertices of the component.
    """

    component: Component
    root_areas: tuple[float, float]
    anchors: IntArray


def anchored_components(
    V: FloatArray, F: IntArray, anchors: IntArray, label: IntArray | None = None
) -> list[AnchoredComponent]:
    """Find the components of a mesh that some anchors (m,) lie on.

    Parameters are those of `geodesic_fields`.

    Raises
    ------
    CapacityError
        If an anchor lies in no large component.
    """
    found = []
    components = large_components(V, F, label)
    root_areas = shared_root_areas(V, components)
    for component, root_area in zip(components, root_areas, strict=True):
        local = np.full(len(V), -1)
        local[component.vertices] = np.arange(len(component.vertices))
        own = local[anchors][local[anchors] >= 0]
        if own.size:
            found.append(AnchoredComponent(component, (root_area, root_areas[0]), own))
    if sum(len(each.anchors) for each in found) < len(anchors):
        raise CapacityError("an anchor lies in a piece that is too small in some frame")
    return found


def geodesic_fields(
    V: FloatArray,
    F: IntArray,
    anchors: IntArray,
    label: IntArray | None = None,
    proxies: Proxies | None = None,
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
    proxies : Proxies, optional
        To measure fine components on; by default all are measured as they are.

    Raises
    ------
    CapacityError
        If an anchor lies in no large component.
    """
    fields = []
    for each in anchored_components(V, F, anchors, label):
        points = V[each.component.vertices]
        geodesics = distances_on(points, each.component, proxies)
        persistence = np.zeros(len(each.anchors))
        fields.append(
            measure_field(
                each.component, points, each.root_areas, geodesics, each.anchors, persistence
            )
        )
    return fields


def distances_on(
    V: FloatArray, component: Component, proxies: Proxies | None
) -> GeodesicDistances | ProxyDistances:
    """Choose how to measure distances on a component whose vertices are at V (n, 3)."""
    if proxies is None:
        return GeodesicDistances(V, component.faces)
    return proxies.distances(V, component)


def measure_field(
    component: Component,
    V: FloatArray,
    root_areas: tuple[float, float],
    geodesics: GeodesicDistances | ProxyDistances,
    anchors: IntArray,
    persistence: FloatArray,
) -> GeodesicField:
    """Measure distances from anchors (m,), vertices of the component.

    Other parameters are those of `GeodesicField`; `root_areas` are the component's, and that of
    the largest one.
    """
    scale = geodesics.root_area / root_areas[0]
    on_proxy = None
    if isinstance(geodesics, ProxyDistances):
        of_proxy = scale * geodesics.to_proxy(anchors)
        H = geodesics.proxy.prolong(of_proxy)
        on_proxy = ProxyField(geodesics.proxy, geodesics.V, of_proxy)
    else:
        H = scale * geodesics.from_vertices(anchors)
    return GeodesicField(
        component=component,
        V=V,
        length_scale=root_areas[0],
        reference_root_area=root_areas[1],
        anchors=component.vertices[anchors],
        persistence=persistence,
        H=H,
        on_proxy=on_proxy,
    )


def _mean_by_area(V: FloatArray, F: IntArray, values: FloatArray) -> FloatArray:
    """Mean over a mesh of values (m, k) at its vertices, (m,)."""
    areas = vertex_areas(V, F)
    return values @ areas / areas.sum()
