"""One connectivity for a whole animation: what was made on one frame, carried to the others."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.topology import Topology
from meshmark_plugins.attacks.frames import (
    CombinePoints,
    KeepPoints,
    RandomFunction,
    naming,
    require_trajectories,
    treat_frames,
)

_CANDIDATES = 16

# (first frame, (M, 3) points and (F, 3) faces made of it) -> how every frame gets them.
Carry = Callable[[Frame, FloatArray, IntArray], KeepPoints | CombinePoints]


def rebuild(
    attack: str,
    animation: MeshAnimation,
    function: RandomFunction,
    carry: Carry,
    per: str,
    rng: np.random.Generator,
) -> MeshAnimation:
    """Give an animation a new connectivity.

    Parameters
    ----------
    attack : str
        Name, for messages.
    function : RandomFunction
        Makes another mesh of a frame.
    carry : Carry
        Carries what was made of the first frame to the others.
    per : {"frame", "animation"}
        Every frame by itself; or the first frame only, carried to all.
    """
    if per == "frame":
        single = len(animation) == 1
        return treat_frames(animation, function, rng, constant_topology=single)
    require_trajectories(attack, animation, "per='animation'")
    first = animation[0]
    with naming(animation.origin, animation.prim, first.time):
        fresh = function(first, rng)
    return animation.map(carry(first, fresh.points, fresh.faces))


def carry_by_vertices(frame: Frame, V: FloatArray, F: IntArray) -> KeepPoints:
    """Put each vertex of a smaller mesh on a vertex of the frame, each on one of its own.

    Parameters
    ----------
    frame : Frame
        The frame the smaller mesh was made from.
    V : (M, 3) float64
        Its vertices, M <= N.
    F : (F, 3) int
        Its triangles.
    """
    return KeepPoints(nearest_distinct(frame.points, V), Topology.from_triangles(F, len(V)))


def carry_by_surface(frame: Frame, V: FloatArray, F: IntArray) -> CombinePoints:
    """Pin each vertex of another mesh to the closest point of the frame's surface.

    Parameters
    ----------
    frame : Frame
        The frame the other mesh was made from.
    V : (M, 3) float64
        Its vertices.
    F : (F, 3) int
        Its triangles.
    """
    face, weights = ClosestPoints(frame.points, frame.faces).find(V)
    rows = np.repeat(np.arange(len(V)), 3)
    shape = (len(V), len(frame.points))
    W = csr_matrix((weights.ravel(), (rows, frame.faces[face].ravel())), shape=shape)
    return CombinePoints(W, Topology.from_triangles(F, len(V)))


def nearest_distinct(V: FloatArray, P: FloatArray) -> IntArray:
    """Give each point a near vertex that no other point has.

    Every point asks for the nearest vertex that is free; where several ask for the same, the
    nearest point has it, and the others ask again.

    Parameters
    ----------
    V : (N, 3) float64
        Vertices.
    P : (M, 3) float64
        Points, M <= N.

    Returns
    -------
    (M,) int
        Vertex of each point, all different.
    """
    given = np.full(len(P), -1, dtype=np.int64)
    free = np.arange(len(V))
    while (waiting := np.flatnonzero(given < 0)).size:
        k = min(_CANDIDATES, len(free))
        distance, place = cKDTree(V[free]).query(P[waiting], k=k)
        distance, place = distance.reshape(-1, k), place.reshape(-1, k)
        taken = np.zeros(len(free), dtype=bool)
        open_ = np.ones(len(waiting), dtype=bool)
        for column in range(k):
            asking = np.flatnonzero(open_ & ~taken[place[:, column]])
            order = asking[np.argsort(distance[asking, column], kind="stable")]
            vertices, first = np.unique(place[order, column], return_index=True)
            winners = order[first]
            given[waiting[winners]] = free[vertices]
            taken[vertices] = True
            open_[winners] = False
        free = free[~taken]
    return given
