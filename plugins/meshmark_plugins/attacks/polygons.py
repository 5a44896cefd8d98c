"""Topologies of polygons after vertices went or were renamed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshmark.animation import Topology

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


def restrict(topology: Topology, keep: BoolArray) -> tuple[IntArray, Topology | None]:
    """Keep the polygons all of whose corners are kept, and the vertices they use.

    Parameters
    ----------
    topology : Topology
        Polygons over N points.
    keep : (N,) bool
        Vertices that stay.

    Returns
    -------
    indices : (M,) int
        Old index of each vertex of the result, increasing.
    topology : Topology or None
        The kept polygons over the M vertices; None if no polygon is left.
    """
    owner = np.repeat(np.arange(len(topology.counts)), topology.counts)
    lost = np.bincount(owner, ~keep[topology.indices], len(topology.counts)) > 0
    corners = topology.indices[~lost[owner]]
    if not len(corners):
        return np.empty(0, dtype=np.int64), None
    indices, renamed = np.unique(corners, return_inverse=True)
    kept = Topology(topology.counts[~lost], renamed.reshape(-1), len(indices))
    return indices, kept
