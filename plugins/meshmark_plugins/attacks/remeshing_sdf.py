"""A new surface around the old one: the signed distance field's zero set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.open3d_import import load_open3d
from meshmark.mesh.topology import Topology, boundary_edges, edges, weld
from meshmark_plugins.attacks.carrying import carry_by_surface, rebuild
from meshmark_plugins.attacks.frames import PER
from meshmark_plugins.attacks.parameters import choice, whole
from meshmark_plugins.attacks.polygons import require_triangles

GridArray = NDArray[np.float32]

_OPEN = 0.05
_COARSER = 4
_MARGIN = 2
# Open3d decides inside or outside by a majority of this many rays.
_VOTES = 3


@dataclass(frozen=True)
class RemeshingSdf:
    """Sample the signed distance on a grid, and triangulate its zero set.

    Inner faces and self-intersections vanish; every vertex and edge is new. An open surface has
    no inside: a mesh with more than a few border edges is refused.

    Parameters
    ----------
    resolution : int
        Cells along the longest side of the bounding box, in [8, 256].
    per : {"frame", "animation"}
        Every frame by itself; or the first frame only, its new surface pinned to the old one
        and carried along by it.

    Raises
    ------
    UsageError
        If a parameter is out of range.

    References
    ----------
    W. E. Lorensen, H. E. Cline, "Marching cubes: a high resolution 3D surface construction
    algorithm", SIGGRAPH 1987, doi:10.1145/37401.37422.
    """

    resolution: int = 128
    per: str = "animation"

    def __post_init__(self) -> None:
        resolution = whole("remeshing-sdf", "resolution", self.resolution, 8, 256)
        object.__setattr__(self, "resolution", resolution)
        choice("remeshing-sdf", "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the remeshed animation."""
        function = RemeshFrame(self.resolution)
        return rebuild("remeshing-sdf", animation, function, carry_by_surface, self.per, rng)


@dataclass(frozen=True)
class RemeshFrame:
    """Remeshes one frame."""

    resolution: int

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the remeshed frame."""
        require_closed(frame.points, frame.faces)
        V, F = marching_cubes(frame.points, frame.faces, self.resolution)
        V, F = require_triangles(V, F, "remeshing")
        return Frame(frame.time, V, Topology.from_triangles(F, len(V)))


def require_closed(V: FloatArray, F: IntArray) -> None:
    """Refuse a mesh of which, once welded, more than a twentieth of the edges are borders.

    Raises
    ------
    InputError
        With the numbers.
    """
    _, welded, _ = weld(V, F)
    border, total = len(boundary_edges(welded)), len(edges(welded))
    if border > _OPEN * total:
        raise InputError(
            f"remeshing-sdf takes a closed surface, but {border} of {total} edges are borders"
        )


def marching_cubes(V: FloatArray, F: IntArray, resolution: int) -> tuple[FloatArray, IntArray]:
    """Triangulate the zero set of a closed mesh's signed distance.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    resolution : int
        Cells along the longest side of the bounding box.

    Returns
    -------
    V : (M, 3) float64
        New vertex positions.
    F : (G, 3) int
        New triangles, oriented outward; none for a mesh without an inside.
    """
    o3d = load_open3d()
    low = V.min(axis=0)
    cell = float(np.ptp(V, axis=0).max()) / resolution
    local = ((V - low) / cell).astype(np.float32)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(local, F.astype(np.uint32))
    size = np.ceil(local.max(axis=0)).astype(np.int64) + 2 * _MARGIN + 1
    field = signed_distances(scene, size)
    if not (field < 0).any():
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    surface = o3d.t.geometry.TriangleMesh.create_isosurfaces(
        o3d.core.Tensor(np.ascontiguousarray(field.transpose(2, 1, 0)))
    )
    points = surface.vertex.positions.numpy().astype(np.float64)
    faces = surface.triangle.indices.numpy().astype(np.int64)
    # The field is negative inside, where the library expects it positive.
    return low + (points - _MARGIN) * cell, faces[:, ::-1]


def signed_distances(scene: Any, size: IntArray) -> GridArray:
    """Sample the signed distance at the corners of unit cells, exactly near the surface only.

    A coarse grid tells where the surface cannot be: a distance changes by no more than one goes.
    There the coarse values, interpolated, do for the sign.

    Parameters
    ----------
    scene : open3d.t.geometry.RaycastingScene
        The surface.
    size : (3,) int
        Number of corners along each axis; the first lies at (-2, -2, -2).

    Returns
    -------
    (size) float32
        Negative inside.
    """
    few = -(-size // _COARSER) + 1
    field = _distances_at(scene, np.argwhere(np.ones(few, dtype=bool)) * _COARSER).reshape(few)
    for axis in range(3):
        field = _stretch(field, axis, int(size[axis]))
    near = np.abs(field) < _COARSER * np.sqrt(3.0)
    field[near] = _distances_at(scene, np.argwhere(near))
    return field


def _stretch(field: GridArray, axis: int, size: int) -> GridArray:
    """Interpolate linearly along an axis, from coarse to fine corners."""
    below, rest = np.divmod(np.arange(size), _COARSER)
    shape = [1, 1, 1]
    shape[axis] = size
    share = (rest / _COARSER).astype(np.float32).reshape(shape)
    return field.take(below, axis) * (1 - share) + field.take(below + 1, axis) * share


def _distances_at(scene: Any, corners: IntArray) -> GridArray:
    query = (corners - _MARGIN).astype(np.float32)
    return scene.compute_signed_distance(query, nsamples=_VOTES).numpy()
