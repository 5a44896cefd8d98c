"""Solvers that want one connected mesh, made to serve any mesh."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.topology import vertex_components
from meshmark_plugins.geodesics.base import BaseSolver

OneSource = Callable[[int], FloatArray]
"""Distances (n,) from one vertex to all of a connected mesh."""


class ComponentwiseSolver(BaseSolver):
    """One solver for each connected component, built when a source first lies in it.

    Parameters
    ----------
    V : (N, 3) array_like of float
        Vertex positions.
    F : (F, 3) array_like of int
        Triangles; those with a repeated corner are left out.
    """

    def __init__(self, V: ArrayLike, F: ArrayLike) -> None:
        super().__init__(V, F)
        self._F = self._F[(np.roll(self._F, 1, axis=1) != self._F).all(axis=1)]
        self._component = vertex_components(self._F, len(self._V))
        self._built: dict[int, tuple[IntArray, float, OneSource, IntArray]] = {}

    @abstractmethod
    def _build(self, V: FloatArray, F: IntArray) -> OneSource:
        """Build on the vertices (n, 3) and triangles (f, 3) of one component.

        It has no unused vertex, and is scaled to a bounding box with diagonal 1.
        """

    def _measure(self, sources: IntArray) -> FloatArray:
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
