"""Cutting a mesh into pieces that stay where they were."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import normalized
from meshmark.mesh.topology import Topology
from meshmark_plugins.attacks.frames import mean_radius, require_trajectories
from meshmark_plugins.attacks.parameters import number, whole
from meshmark_plugins.attacks.polygons import neighbours


@dataclass(frozen=True)
class Cutting:
    """Cut a mesh into connected pieces and move each a little; points along cuts are doubled.

    Points that no polygon uses go, as an exporter would drop them.

    Parameters
    ----------
    patches : int
        Number of polygons, chosen at random, that pieces grow from, polygon after polygon; all
        of them if they are fewer. In [1, 10000]. What no piece reaches stays together.
    gap : float
        How far each piece moves, in a random direction, the same in all frames: a fraction of
        d, the mean distance of the first frame's vertices to their mean. In [0, 1].

    Raises
    ------
    UsageError
        If a parameter is out of range, or the connectivity changes from frame to frame.
    """

    patches: int = 12
    gap: float = 1e-6

    def __post_init__(self) -> None:
        object.__setattr__(self, "patches", whole("cutting", "patches", self.patches, 1, 10_000))
        object.__setattr__(self, "gap", number("cutting", "gap", self.gap, 0, 1))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the animation in pieces."""
        require_trajectories("cutting", animation, "one cut for all frames")
        first = animation[0]
        piece = grow(first.topology, self.patches, rng)
        moves = (
            normalized(rng.normal(size=(piece.max() + 1, 3))) * self.gap * mean_radius(first.points)
        )
        return animation.map(cut(first.topology, piece, moves))


@dataclass(frozen=True, eq=False)
class CutPoints:
    """Some of a frame's points, as often as pieces use them, and moved with those.

    Parameters
    ----------
    indices : (M,) int
        Old index of each point.
    moves : (M, 3) float64
        Its displacement.
    topology : Topology
        Polygons over the M points.
    """

    indices: IntArray
    moves: FloatArray
    topology: Topology

    def __call__(self, frame: Frame) -> Frame:
        """Return the frame in pieces."""
        return Frame(frame.time, frame.points[self.indices] + self.moves, self.topology)


def cut(topology: Topology, piece: IntArray, moves: FloatArray) -> CutPoints:
    """Give each piece points of its own.

    Parameters
    ----------
    topology : Topology
        P polygons over N points.
    piece : (P,) int
        Piece of each polygon.
    moves : (K, 3) float64
        Displacement of each piece.
    """
    n = topology.n_points
    own, renamed = np.unique(
        np.repeat(piece, topology.counts) * n + topology.indices, return_inverse=True
    )
    polygons = Topology(topology.counts, renamed.reshape(-1), len(own))
    return CutPoints(own % n, moves[own // n], polygons)


def grow(topology: Topology, patches: int, rng: np.random.Generator) -> IntArray:
    """Grow pieces from random polygons over their edges, all at once, (P,) int from 0."""
    n = len(topology.counts)
    i, j = neighbours(topology)[0].T
    graph = csr_matrix((np.ones(len(i)), (i, j)), shape=(n, n))
    seeds = rng.choice(n, min(patches, n), replace=False)
    *_, source = dijkstra(
        graph,
        directed=False,
        indices=seeds,
        unweighted=True,
        min_only=True,
        return_predecessors=True,
    )
    return np.unique(source, return_inverse=True)[1].reshape(-1)
