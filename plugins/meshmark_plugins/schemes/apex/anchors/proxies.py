"""The proxies of a mesh that is too fine to measure distances on at every vertex."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import Frame
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.heat_distances import HeatTopology
from meshmark.mesh.proxy import Proxy, build_proxy
from meshmark_plugins.schemes.apex.anchors.components import Component, large_components
from meshmark_plugins.schemes.apex.anchors.geodesics import GeodesicDistances, distance_topology
from meshmark_plugins.schemes.apex.anchors.proxy_distances import ProxyDistances

# Components of more vertices are measured on proxies of about so many.
MOST_VERTICES, PROXY_VERTICES = 32_000, 12_000
# What is restored has no proxies of its own where its area is more than this times what it was: it
# is full of noise. What was smoothed indeed gains a tenth at most.
MAX_ROUGHNESS = 1.5
# Where displacements are solved for, too, it takes more: they change within a bin.
MARKING_PROXY_VERTICES = 16_000


class Proxies:
    """The proxies of the components of one topology, each built when it is first needed.

    Parameters
    ----------
    V : (N, 3) float64
        The pose they are built in.
    n_vertices : int, optional
        About how many vertices each has; `PROXY_VERTICES` by default.
    instead : Proxies, optional
        Built in another pose of the same mesh, for components that this one is too rough for.
    """

    def __init__(
        self, V: FloatArray, n_vertices: int | None = None, instead: Proxies | None = None
    ) -> None:
        self._V, self._n_vertices, self._instead = V, n_vertices or PROXY_VERTICES, instead
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
        name = _name(component)
        if name not in self._built:
            self._built[name] = self._build(component)
        return self._built[name]

    def _build(self, component: Component) -> Proxy | None:
        instead = self._instead
        if instead is not None and self._area(component) > MAX_ROUGHNESS * instead._area(component):
            return instead.of(component)
        points = self._V[component.vertices]
        built = build_proxy(points, component.faces, self._n_vertices)
        return instead.of(component) if built is None and instead is not None else built

    def _area(self, component: Component) -> float:
        return float(face_areas(self._V[component.vertices], component.faces).sum())


class MarkingProxies(Proxies):
    """The proxies that a mesh is marked by, and what makes many poses of it quick to measure.

    Proxies are built at once, so that worker processes need not do so.

    Parameters
    ----------
    V : (N, 3) float64
        The pose they are built in.
    F : (F, 3) int
        Triangles.
    """

    def __init__(self, V: FloatArray, F: IntArray) -> None:
        super().__init__(V, MARKING_PROXY_VERTICES)
        self._topologies: dict[tuple[int, ...], HeatTopology | None] = {}
        self._surpluses: dict[tuple[int, ...], dict[int, float]] = {}
        self._references: dict[tuple[int, ...], ProxyDistances] = {}
        for component in large_components(V, F):
            proxy, points = self.of(component), V[component.vertices]
            surface = (
                (points, component.faces) if proxy is None else (proxy.fit(points), proxy.faces)
            )
            self._topologies[_name(component)] = distance_topology(*surface)

    def distances(self, V: FloatArray, component: Component) -> GeodesicDistances | ProxyDistances:
        """Choose how to measure distances on a component whose vertices are at V (n, 3)."""
        proxy, topology = self.of(component), self._topologies.get(_name(component))
        if proxy is None:
            return GeodesicDistances(V, component.faces, topology=topology)
        surpluses = partial(self._surpluses_of, component, proxy)
        return ProxyDistances(V, component.faces, proxy, topology, surpluses)

    def _surpluses_of(self, component: Component, proxy: Proxy, sources: IntArray) -> FloatArray:
        """Measure surpluses of distances from vertices in the pose the proxy is of, once each."""
        name = _name(component)
        known = self._surpluses.setdefault(name, {})
        new = np.setdiff1d(sources, list(known))
        if len(new):
            if name not in self._references:
                points, topology = self._V[component.vertices], self._topologies.get(name)
                self._references[name] = ProxyDistances(points, component.faces, proxy, topology)
            found = self._references[name].surpluses(new)
            known.update(zip(new.tolist(), found.tolist(), strict=True))
        return np.array([known[source] for source in sources.tolist()])

    def __getstate__(self) -> dict[str, Any]:
        # Factors are built in less time than they are sent in.
        return {**vars(self), "_references": {}}


@lru_cache(maxsize=8)
def proxies_of(frame: Frame) -> Proxies:
    """Return the proxies built in the pose of a frame; remembered for the frames used last.

    Undoing smoothing makes a copy rough that was not smoothed. Then they are those of the frame as
    it was found: measuring the mesh itself would take long, and noise make all ways longer.
    """
    found = frame.as_found
    return Proxies(frame.points, instead=None if found is None else proxies_of(found))


def _name(component: Component) -> tuple[int, ...]:
    """First triangle of a component: what tells it from others, in any pose."""
    return tuple(component.vertices[component.faces[0]].tolist())
