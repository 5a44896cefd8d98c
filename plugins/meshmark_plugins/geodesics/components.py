"""Solvers that want one connected mesh, made to serve any mesh."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.topology import vertex_components

OneSource = Callable[[int], FloatArray]
"""Distances (n,) from one vertex to all of a connected mesh."""


class ComponentSolvers:
    """One solver for each connected component, built when a source first lies in it.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles; those with a repeated corner are left out.
    build : callable
        Makes a `OneSource` from the vertices (n, 3) and triangles (f, 3) of a component, which
        has no unused vertex and is scaled to a bounding box with diagonal 1.
    """

    def __init__(
        self, V: FloatArray, F: IntArray, build: Callable[[FloatArray, IntArray], OneSource]
    ) -> None:
        proper = (np.roll(F, 1, axis=1) != F).all(axis=1)
        self._V, self._F, self._build = V, F[proper], build
        self._component = vertex_components(self._F, len(V))
        self._built: dict[int, tuple[IntArray, float, OneSource, IntArray]] = {}

    def distances(self, sources: IntArray) -> FloatArray:
        """Measure from each source, (S, N) float64; inf outside its component."""
        D = np.full((len(sources), len(self._V)), np.inf)
        for row, source in zip(D, sources.tolist(), strict=True):
            vertices, scale, solve, place = self._solver(int(self._component[source]))
            row[vertices] = scale * solve(int(place[source]))
        return D

    def _solver(self, component: int) -> tuple[IntArray, float, OneSource, IntArray]:
        if component not in self._built:
            vertices = np.flatnonzero(self._component == component)
            place = np.full(len(self._V), -1)
            place[vertices] = np.arange(len(vertices))
            faces = place[self._F[self._component[self._F[:, 0]] == component]]
            points = self._V[vertices]
            scale = float(np.linalg.norm(np.ptp(points, axis=0))) or 1.0
            unit = (points - points.mean(axis=0)) / scale
            # An unused vertex is a component without faces.
            solve = self._build(unit, faces) if len(faces) else _alone
            self._built[component] = vertices, scale, solve, place
        return self._built[component]


def _alone(source: int) -> FloatArray:
    """Measure from a vertex that nothing joins: to itself alone."""
    return np.zeros(1)
