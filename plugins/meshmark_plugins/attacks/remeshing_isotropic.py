"""Triangles of even size and shape on the same surface."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module

import numpy as np

from meshmark.errors import InputError, PluginError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology, edges
from meshmark_plugins.attacks.carrying import carry_by_surface, rebuild
from meshmark_plugins.attacks.frames import PER
from meshmark_plugins.attacks.parameters import choice, number, whole
from meshmark_plugins.attacks.polygons import require_triangles


@dataclass(frozen=True)
class RemeshingIsotropic:
    """Split, collapse and flip edges and relax vertices until all edges are about as long.

    Needs the library gpytoolbox, which is not installed by default.

    Parameters
    ----------
    edge : float
        Wanted edge length in mean edge lengths of the mesh, in [0.25, 8].
    iterations : int
        Rounds, in [1, 100].
    per : {"frame", "animation"}
        Every frame by itself; or the first frame only, its new vertices pinned to the old
        surface and carried along by it.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    PluginError
        If gpytoolbox is not installed.

    References
    ----------
    M. Botsch, L. Kobbelt, "A remeshing approach to multiresolution modeling", Symposium on
    Geometry Processing 2004, doi:10.1145/1057432.1057457.
    """

    edge: float = 1.0
    iterations: int = 10
    per: str = "animation"

    def __post_init__(self) -> None:
        name = "remeshing-isotropic"
        object.__setattr__(self, "edge", number(name, "edge", self.edge, 0.25, 8))
        iterations = whole(name, "iterations", self.iterations, 1, 100)
        object.__setattr__(self, "iterations", iterations)
        choice(name, "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the remeshed animation."""
        function = RemeshEvenly(self.edge, self.iterations)
        return rebuild("remeshing-isotropic", animation, function, carry_by_surface, self.per, rng)


@dataclass(frozen=True)
class RemeshEvenly:
    """Remeshes one frame."""

    edge: float
    iterations: int

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the remeshed frame."""
        try:
            gpytoolbox = import_module("gpytoolbox")
        except ImportError as error:
            raise PluginError(
                "remeshing-isotropic needs gpytoolbox: pip install gpytoolbox"
            ) from error
        V, F = require_triangles(frame.points, frame.faces, "triangulation")
        E = edges(F)
        length = self.edge * float(np.linalg.norm(V[E[:, 0]] - V[E[:, 1]], axis=1).mean())
        try:
            points, faces = gpytoolbox.remesh_botsch(
                V, F.astype(np.int32), i=self.iterations, h=length, project=True
            )
        except ValueError as error:
            raise InputError(f"remeshing-isotropic cannot remesh it: {error}") from error
        V, F = require_triangles(points.astype(np.float64), faces.astype(np.int64), "remeshing")
        return Frame(frame.time, V, Topology.from_triangles(F, len(V)))
