"""What displacements of a mesh are planned on: itself, or a proxy of it where it is fine."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix, eye_array, hstack

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import vertex_areas
from meshmark.mesh.proxy import Proxy
from meshmark_plugins.schemes.apex.anchors.components import Component
from meshmark_plugins.schemes.apex.anchors.geodesic_field import (
    GeodesicField,
    anchored_components,
)
from meshmark_plugins.schemes.apex.anchors.proxies import Proxies


@dataclass(frozen=True, eq=False)
class Part:
    """A component of the mesh, and what of it is displaced.

    Parameters
    ----------
    vertices : (N,) int
        Of the mesh.
    component : Component
        Of the proxy, or the mesh's own.
    prolongation : (N, n) sparse float64
        Barycentric coordinates of each vertex of the mesh's component in a triangle of what is
        displaced.
    """

    vertices: IntArray
    component: Component
    prolongation: csr_matrix

    def spread(self, J: csr_matrix, n_points: int) -> csr_matrix:
        """Turn derivatives (k, 3 n) by moves of the part into those by moves of all, (k, 3 N)."""
        if len(self.component.vertices) == n_points:
            return J
        columns = (3 * self.component.vertices[:, None] + np.arange(3)).ravel()
        return csr_matrix((J.data, columns[J.indices], J.indptr), (J.shape[0], 3 * n_points))


@dataclass(frozen=True, eq=False)
class PlanningProxy:
    """What is displaced of all components with anchors.

    Parameters
    ----------
    proxy : Proxy or None
        Of the whole mesh, if some of them are fine; others stand for themselves. Components without
        anchors have no part in it, and do not move. None where the mesh itself is displaced.
    parts : list of Part
        Component after component.
    """

    proxy: Proxy | None
    parts: list[Part]

    def number_of(self, first: int) -> int:
        """Find which part stands for the component of the mesh that has this first vertex."""
        return [int(part.vertices[0]) for part in self.parts].index(first)

    def of_proxy(self, field: GeodesicField) -> GeodesicField:
        """Take distances on a component of the mesh for those on what of it is displaced."""
        V, _, H = field.surface
        number = self.number_of(int(field.component.vertices[0]))
        component = self.parts[number].component
        return replace(field, component=component, V=V, H=H, on_proxy=None)


def planning_proxy(
    V: FloatArray, F: IntArray, anchors: IntArray, proxies: Proxies
) -> PlanningProxy:
    """Put together the proxies of the components with anchors, if any of them has one."""
    components = [each.component for each in anchored_components(V, F, anchors)]
    own = [proxies.of(component) for component in components]
    if not any(own):
        return PlanningProxy(None, [_own_part(component) for component in components])
    parts, placed, samples, faces, weights = [], [], [], [], np.zeros(len(V))
    first = 0
    for component, built in zip(components, own, strict=True):
        proxy = built or _itself(V[component.vertices], component.faces)
        P, n = proxy.prolongation.tocoo(), len(proxy.samples)
        placed.append(csr_matrix((P.data, (component.vertices[P.row], P.col)), (len(V), n)))
        samples.append(component.vertices[proxy.samples])
        faces.append(first + proxy.faces)
        weights[component.vertices] = proxy.weights
        of_proxy = Component(np.arange(first, first + n), proxy.faces)
        parts.append(Part(component.vertices, of_proxy, proxy.prolongation))
        first += n
    prolongation = csr_matrix(hstack(placed, format="csr"))
    joined = Proxy(np.concatenate(samples), np.concatenate(faces), prolongation, weights)
    return PlanningProxy(joined, parts)


def _own_part(component: Component) -> Part:
    """Let a component be displaced itself."""
    return Part(component.vertices, component, csr_matrix(eye_array(len(component.vertices))))


def _itself(V: FloatArray, F: IntArray) -> Proxy:
    """Make a mesh its own proxy."""
    n = len(V)
    return Proxy(np.arange(n), F, csr_matrix(eye_array(n)), vertex_areas(V, F))
