"""The proxies of a mesh that is too fine to measure distances on at every vertex."""

from __future__ import annotations

from functools import lru_cache

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame
from meshmark.mesh.proxy import Proxy, build_proxy
from meshmark_plugins.schemes.apex.anchors.components import Component
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances
from meshmark_plugins.schemes.apex.anchors.proxy_distances import ProxyDistances

# Components of more vertices are measured on proxies of about so many.
MOST_VERTICES, PROXY_VERTICES = 32_000, 12_000


class Proxies:
    """The proxies of the components of one topology, each built when it is first needed.

    Parameters
    ----------
    V : (N, 3) float64
        The pose they are built in.
    """

    def __init__(self, V: FloatArray) -> None:
        self._V = V
        self._built: dict[tuple[int, ...], Proxy | None] = {}

    def distances(self, V: FloatArray, component: Component) -> GeodesicDistances | ProxyDistances:
        """Choose how to measure distances on a component whose vertices are at V (n, 3)."""
        proxy = self.of(component)
        if proxy is None:
            return GeodesicDistances(V, component.faces)
        return ProxyDistances(V, component.faces, proxy)

    def of(self, component: Component) -> Proxy | None:
        """Return the proxy of a component, if it needs one and there is a good one."""
        if len(component.vertices) <= MOST_VERTICES:
            return None
        triangle = tuple(component.vertices[component.faces[0]].tolist())
        if triangle not in self._built:
            points = self._V[component.vertices]
            self._built[triangle] = build_proxy(points, component.faces, PROXY_VERTICES)
        return self._built[triangle]


@lru_cache(maxsize=4)
def proxies_of(frame: Frame) -> Proxies:
    """Return the proxies built in the pose of a frame; remembered for the frames used last."""
    return Proxies(frame.points)
