"""Joining something to a mesh that nobody looks at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import face_areas, normalized
from meshmark.mesh.topology import Topology, polygon_edges
from meshmark_plugins.attacks.frames import naming, require_trajectories
from meshmark_plugins.attacks.parameters import choice, number
from meshmark_plugins.attacks.polygons import join, neighbours

_GROUND = 40
_BODY, _BUMPS, _BUMP_HEIGHT, _BUMP_WIDTH = 2000, 8, 1.5, 0.3
# Side of a folded sheet, and distance of its folds, over the mesh's extent.
_SHEET, _FOLD = 0.05, 1e-6


@dataclass(frozen=True)
class Joining:
    """Make a mesh and something else one mesh; the mesh itself stays as it is.

    Parameters
    ----------
    thing : {"ground", "box", "body", "sheet", "wall"}
        A square plane of 1,600 points below the mesh; a box of 8 points about it; a second
        closed body of 2,000 points, with eight horns, beside it; a sheet folded to a packet in
        its middle, hung on one of its edges; or a wall across it, along edges of its own.
    size : float
        Side of the ground or box, or largest extent of the body, over the mesh's largest
        extent. In (0, 1000].
    area : float
        Area of the sheet over that of the mesh. In (0, 100].

    Raises
    ------
    UsageError
        If a parameter is out of range, or the connectivity changes from frame to frame.
    InputError
        If the mesh has no edge that a wall could stand on.
    """

    thing: str = "ground"
    size: float = 3.0
    area: float = 5.0

    def __post_init__(self) -> None:
        choice("joining", "thing", self.thing, tuple(_THINGS))
        size = number("joining", "size", self.size, 0, 1000, low_open=True)
        area = number("joining", "area", self.area, 0, 100, low_open=True)
        object.__setattr__(self, "size", size)
        object.__setattr__(self, "area", area)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the animation with the thing joined to it, which moves along with its mean."""
        require_trajectories("joining", animation, "one thing for all frames")
        with naming(animation.origin, animation.prim, float(animation.times[0])):
            return animation.map(_THINGS[self.thing](self, animation[0], rng))


@dataclass(frozen=True, eq=False)
class JoinPoints:
    """A frame's points and others, which stay where they are relative to a mean of its points.

    Parameters
    ----------
    offsets : (M, 3) float64
        Where the others are.
    anchor : (K,) int
        Vertices they are relative to the mean of.
    topology : Topology
        Polygons over the N + M points.
    """

    offsets: FloatArray
    anchor: IntArray
    topology: Topology

    def __call__(self, frame: Frame) -> Frame:
        """Return the frame with the other points behind its own."""
        middle = frame.points[self.anchor].mean(axis=0)
        points = np.concatenate([frame.points, middle + self.offsets])
        return Frame(frame.time, points, self.topology)


def _beside(frame: Frame, offsets: FloatArray, F: IntArray) -> JoinPoints:
    """Join triangles over points of their own, given relative to the mean of all points."""
    n = len(frame.points)
    return JoinPoints(offsets, np.arange(n), join(frame.topology, F + n, len(offsets)))


def _extent(frame: Frame) -> float:
    return float(np.ptp(frame.points, axis=0).max())


def _ground(attack: Joining, frame: Frame, rng: np.random.Generator) -> JoinPoints:
    x, z = np.meshgrid(*[np.linspace(-0.5, 0.5, _GROUND)] * 2, indexing="ij")
    V = attack.size * _extent(frame) * np.stack([x, np.zeros_like(x), z], axis=2).reshape(-1, 3)
    V[:, 1] += frame.points[:, 1].min() - frame.points[:, 1].mean()
    return _beside(frame, V, _grid(_GROUND, _GROUND))


def _box(attack: Joining, frame: Frame, rng: np.random.Generator) -> JoinPoints:
    V = attack.size * _extent(frame) * (_corners() - 0.5)
    hull = ConvexHull(V)
    return _beside(frame, V, hull.simplices.astype(np.int64))


def _corners() -> FloatArray:
    return np.stack(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij"), axis=3).reshape(-1, 3)


def _body(attack: Joining, frame: Frame, rng: np.random.Generator) -> JoinPoints:
    # Points in a spiral, evenly over the sphere.
    z = 1.0 - (2.0 * np.arange(_BODY) + 1.0) / _BODY
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_BODY)
    r = np.sqrt(1.0 - z**2)
    V = np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=1)
    F = ConvexHull(V).simplices.astype(np.int64)
    angle = np.arccos(np.clip(V @ normalized(rng.normal(size=(_BUMPS, 3))).T, -1.0, 1.0))
    V *= 1.0 + _BUMP_HEIGHT * np.exp(-((angle / _BUMP_WIDTH) ** 2)).sum(axis=1, keepdims=True)
    extent = _extent(frame)
    V *= attack.size * extent / np.ptp(V, axis=0).max()
    away = normalized(rng.normal(size=(1, 3))) * (1.0 + attack.size) * extent
    return _beside(frame, V + away, F)


def _sheet(attack: Joining, frame: Frame, rng: np.random.Generator) -> JoinPoints:
    extent = _extent(frame)
    area, side = attack.area * face_areas(frame.points, frame.faces).sum(), _SHEET * extent
    n = int(np.ceil(area / side**2))
    row = np.arange(n + 1)
    front = np.stack([side * (row % 2), _FOLD * extent * row, np.zeros(n + 1)], axis=1)
    V = np.repeat(front, 2, axis=0)
    V[1::2, 2] = area / (n * side)
    a, b = rng.choice(polygon_edges(frame.topology.counts, frame.topology.indices)[0])
    # The flap that it hangs on: from the edge a, b to the sheet's own first edge.
    first = len(frame.points)
    flap = np.array([[a, b, first], [b, first + 1, first]])
    faces = np.concatenate([flap, _grid(n + 1, 2) + first])
    return JoinPoints(V, np.arange(first), join(frame.topology, faces, len(V)))


def _wall(attack: Joining, frame: Frame, rng: np.random.Generator) -> JoinPoints:
    topology = frame.topology
    height = frame.points @ rng.normal(size=3)
    start = np.cumsum(topology.counts) - topology.counts
    middle = np.add.reduceat(height[topology.indices], start) / topology.counts
    above = middle > np.median(middle)
    pairs, shared = neighbours(topology)
    rim = shared[above[pairs[:, 0]] != above[pairs[:, 1]]]
    if not len(rim):
        raise InputError("attack joining: the mesh has no edge that a wall could stand on")
    fan = np.column_stack([rim, np.full(len(rim), len(frame.points))])
    return JoinPoints(np.zeros((1, 3)), np.unique(rim), join(topology, fan, 1))


def _grid(m: int, n: int) -> IntArray:
    """Make two triangles of each cell of m by n points, row after row."""
    i = np.arange(m * n).reshape(m, n)
    a, b, c, d = i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]
    halves = np.stack([np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)])
    return halves.reshape(-1, 3)


_THINGS = {"ground": _ground, "box": _box, "body": _body, "sheet": _sheet, "wall": _wall}
