"""Fewer triangles by edge collapse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.open3d_import import load_open3d
from meshmark.mesh.topology import Topology
from meshmark_plugins.attacks.carrying import carry_by_vertices, rebuild
from meshmark_plugins.attacks.frames import PER
from meshmark_plugins.attacks.parameters import choice, number
from meshmark_plugins.attacks.polygons import require_triangles


@dataclass(frozen=True)
class Simplification:
    """Collapse edges until a share of them is gone. Polygons are triangulated first.

    Parameters
    ----------
    ratio : float
        Fraction of the edges, which on a closed mesh is that of the triangles too, to remove,
        in [0, 1).
    method : {"quadric", "fast"}
        Quadric error metrics as open3d has them, which always collapses the cheapest edge; or
        the threshold variant of the library fast-simplification, which goes through the mesh
        in passes.
    per : {"frame", "animation"}
        Every frame by itself, with new vertices where the error is smallest; or the first frame
        only, with each of its new vertices put on a near old one, and that subset of the
        vertices with these faces in all other frames.

    Raises
    ------
    UsageError
        If a parameter is out of range.

    Notes
    -----
    The benchmark uses the collapse of Lindstrom and Turk, which no freely licensed library at
    hand has; both methods here minimise squared distances to planes as it does.

    References
    ----------
    M. Garland, P. S. Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH
    1997, doi:10.1145/258734.258849.
    """

    ratio: float = 0.3
    method: str = "quadric"
    per: str = "animation"

    def __post_init__(self) -> None:
        ratio = number("simplification", "ratio", self.ratio, 0, 1, high_open=True)
        object.__setattr__(self, "ratio", ratio)
        choice("simplification", "method", self.method, tuple(_METHODS))
        choice("simplification", "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the simplified animation."""
        function = SimplifyFrame(self.ratio, self.method)
        return rebuild("simplification", animation, function, carry_by_vertices, self.per, rng)


@dataclass(frozen=True)
class SimplifyFrame:
    """Simplifies one frame."""

    ratio: float
    method: str

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the simplified frame."""
        F = frame.faces
        target = max(1, round((1.0 - self.ratio) * len(F)))
        V, F = require_triangles(*_METHODS[self.method](frame.points, F, target), "simplification")
        return Frame(frame.time, V, Topology.from_triangles(F, len(V)))


def _quadric(V: FloatArray, F: IntArray, target: int) -> tuple[FloatArray, IntArray]:
    o3d = load_open3d()
    vertices = o3d.utility.Vector3dVector(V)
    triangles = o3d.utility.Vector3iVector(F.astype(np.int32))
    mesh = o3d.geometry.TriangleMesh(vertices, triangles)
    mesh = mesh.simplify_quadric_decimation(target)
    return np.array(mesh.vertices), np.array(mesh.triangles, dtype=np.int64)


def _fast(V: FloatArray, F: IntArray, target: int) -> tuple[FloatArray, IntArray]:
    import fast_simplification

    points, faces = fast_simplification.simplify(V, F.astype(np.int32), target_count=target)
    return points.astype(np.float64), faces.astype(np.int64)


_METHODS = {"quadric": _quadric, "fast": _fast}
