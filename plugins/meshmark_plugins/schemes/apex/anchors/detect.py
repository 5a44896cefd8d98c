"""Detection of anchors, the tips of a shape's protrusions, in one frame alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.geometry import vertex_areas
from meshmark.mesh.topology import boundary_edges, vertex_adjacency
from meshmark_plugins.schemes.apex.anchors.components import (
    Component,
    large_components,
    shared_root_areas,
)
from meshmark_plugins.schemes.apex.anchors.geodesic_field import (
    GeodesicField,
    distances_on,
    measure_field,
)
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances
from meshmark_plugins.schemes.apex.anchors.integral_distance import integral_distance
from meshmark_plugins.schemes.apex.anchors.persistence import Maxima, persistent_maxima
from meshmark_plugins.schemes.apex.anchors.proxies import Proxies
from meshmark_plugins.schemes.apex.anchors.proxy_distances import ProxyDistances

# How far below a maximum its cap reaches, in root areas.
CAP_HEIGHT = 0.03


@dataclass(frozen=True, eq=False)
class ComponentAnchors:
    """The anchors of one component of a frame, before distances from them are measured.

    Parameters
    ----------
    component : Component
        Which vertices and triangles.
    V : (n, 3) float64
        Positions of the component's vertices.
    root_areas : (float, float)
        Root area in which the component is measured, and that of the largest one.
    geodesics : GeodesicDistances
        Its distances.
    maxima : Maxima
        The anchors, vertices of the component.
    """

    component: Component
    V: FloatArray
    root_areas: tuple[float, float]
    geodesics: GeodesicDistances | ProxyDistances
    maxima: Maxima

    def geodesic_field(self) -> GeodesicField:
        """Measure distances from the anchors."""
        return measure_field(
            self.component,
            self.V,
            self.root_areas,
            self.geodesics,
            self.maxima.vertices,
            self.maxima.persistence,
        )


def detect_anchors(
    V: FloatArray,
    F: IntArray,
    min_persistence: float,
    max_anchors: int,
    proxies: Proxies | None = None,
) -> list[ComponentAnchors]:
    """Detect the anchors of a mesh, component by component.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    min_persistence : float
        Least persistence of an anchor, in root areas of its component.
    max_anchors : int
        Most anchors, over all components: the most persistent ones are kept.
    proxies : Proxies, optional
        To measure fine components on; by default all are measured as they are.

    Raises
    ------
    CapacityError
        If there is no anchor.
    """
    components = large_components(V, F)
    root_areas = shared_root_areas(V, components)
    found: list[ComponentAnchors] = []
    for component, root_area in zip(components, root_areas, strict=True):
        points = V[component.vertices]
        geodesics = distances_on(points, component, proxies)
        maxima = surface_anchors(points, component.faces, geodesics, min_persistence, max_anchors)
        if maxima.vertices.size:
            lengths = (root_area, root_areas[0])
            found.append(ComponentAnchors(component, points, lengths, geodesics, maxima))
    if not found:
        raise CapacityError(
            "no part of the mesh sticks out far enough to measure from: "
            "a mark needs tips such as hands, feet, ears or a tail"
        )
    persistence = np.concatenate([each.maxima.persistence for each in found])
    chosen = np.zeros(len(persistence), dtype=bool)
    chosen[np.argsort(-persistence, kind="stable")[:max_anchors]] = True
    ends = np.cumsum([len(each.maxima.vertices) for each in found])[:-1]
    return [
        replace(each, maxima=each.maxima.subset(kept))
        for each, kept in zip(found, np.split(chosen, ends), strict=True)
        if kept.any()
    ]


def surface_anchors(
    V: FloatArray,
    F: IntArray,
    geodesics: GeodesicDistances | ProxyDistances,
    min_persistence: float,
    max_anchors: int,
) -> Maxima:
    """Detect the anchors of one connected surface, the most persistent first.

    Parameters are those of `detect_anchors`; `geodesics` are the surface's distances.
    """
    if isinstance(geodesics, ProxyDistances):
        proxy = geodesics.proxy
        of_proxy = integral_distance(geodesics.V, proxy.faces, geodesics.on_proxy)
        found = persistent_maxima(of_proxy, proxy.faces, min_persistence)
        found = replace(found, vertices=proxy.samples[found.vertices])
        f = proxy.prolongation @ of_proxy
    else:
        f = integral_distance(V, F, geodesics)
        found = persistent_maxima(f, F, min_persistence)
    centres = cap_centres(V, F, f, found.vertices[:max_anchors])
    return Maxima(centres, found.persistence[:max_anchors])


def cap_centres(V: FloatArray, F: IntArray, f: FloatArray, maxima: IntArray) -> IntArray:
    """Move each maximum to the middle of its cap, where f is at most `CAP_HEIGHT` below it.

    The tip of a hoof or a hand is blunt: which of its vertices is the highest is decided by a
    hair, and another one is in the next pose. The middle of the tip stays.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    f : (N,) float64
        The function.
    maxima : (m,) int
        Its maxima.

    Returns
    -------
    (m,) int
        The vertex of each cap that is nearest to its centre of gravity; a maximum on a border
        stays there, so that it can be told from a tip.
    """
    areas = vertex_areas(V, F)
    adjacency = vertex_adjacency(F, len(V))
    border = np.zeros(len(V), dtype=bool)
    border[boundary_edges(F)] = True
    centres = [
        int(top) if border[top] else _cap_centre(V, f, areas, adjacency, int(top)) for top in maxima
    ]
    return np.array(centres, dtype=np.int64)


def _cap_centre(
    V: FloatArray, f: FloatArray, areas: FloatArray, adjacency: csr_matrix, top: int
) -> int:
    high = np.flatnonzero(f >= f[top] - CAP_HEIGHT)
    label = connected_components(adjacency[high][:, high], directed=False)[1]
    cap = high[label == label[np.searchsorted(high, top)]]
    centre = areas[cap] @ V[cap] / areas[cap].sum()
    return int(cap[np.argmin(np.sum((V[cap] - centre) ** 2, axis=1))])


def distance_to_border(V: FloatArray, F: IntArray, vertices: IntArray) -> FloatArray:
    """Straight distance of vertices from the surface's border, (m,) float64; inf without one."""
    border = np.unique(boundary_edges(F))
    if border.size == 0:
        return np.full(len(vertices), np.inf)
    gaps = V[vertices][:, None] - V[border][None]
    return np.linalg.norm(gaps, axis=2).min(axis=1)
