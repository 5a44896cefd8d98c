"""The mesh as analysis sees it: coincident points merged, faces without extent dropped."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.animation import Frame
from meshmark.mesh.topology import Topology, any_corner, weld

# Where more triangles than this meet in a vertex, as they do in the first corner of a polygon of
# so many corners, rays and distances take time that grows with their square.
MOST_AROUND = 1024


@dataclass(frozen=True, eq=False)
class Welding:
    """How one topology's points and triangles map to the mesh that is analysed.

    Parameters
    ----------
    kept : (M,) int
        Point of the frame that stands for each welded vertex.
    new : (N,) int
        Welded vertex of each point of the frame.
    faces : (K,) int
        Triangle of the frame behind each analysed triangle.
    topology : Topology
        Analysed triangles over the welded vertices.
    """

    kept: IntArray
    new: IntArray
    faces: IntArray
    topology: Topology

    @classmethod
    def of(cls, frame: Frame) -> Welding:
        """Weld the exactly coincident points of a frame, and drop points no face uses.

        Triangles about a vertex in which more than `MOST_AROUND` meet are dropped, too: analysis
        sees a hole there.

        Raises
        ------
        CapacityError
            If no triangle with three distinct corners is left.
        """
        _, F, new = weld(frame.points, frame.faces)
        proper = np.flatnonzero((F[:, 0] != F[:, 1]) & (F[:, 1] != F[:, 2]) & (F[:, 2] != F[:, 0]))
        if proper.size == 0:
            raise CapacityError("the mesh has no face with three distinct corners")
        crowded = np.bincount(F[proper].ravel()) > MOST_AROUND
        if crowded.any():
            proper = proper[~any_corner(crowded, F[proper])]
        if proper.size == 0:
            raise CapacityError(
                f"more than {MOST_AROUND} triangles meet in a corner of every face of the mesh"
            )
        F = F[proper]
        used = np.bincount(F.ravel(), minlength=int(new.max()) + 1) > 0
        slot = np.where(used, np.cumsum(used) - 1, -1)
        F, new, n = slot[F], slot[new], int(used.sum())
        kept = np.full(n, -1)
        # Assigned in reverse, so that the first of several coincident points stays.
        points = np.flatnonzero(new >= 0)[::-1]
        kept[new[points]] = points
        topology = Topology.from_triangles(F, n)
        return cls(kept, new, proper, topology)

    def frame(self, frame: Frame) -> Frame:
        """Return a frame of the same topology as analysis sees it."""
        return Frame(frame.time, frame.points[self.kept], self.topology)

    def polygons(self, topology: Topology) -> Topology:
        """Return the analysed surface in polygons of the frame, where they were kept whole."""
        polygon = np.repeat(np.arange(len(topology.counts)), topology.counts - 2)[self.faces]
        whole = np.bincount(polygon, minlength=len(topology.counts)) == topology.counts - 2
        corners = self.new[topology.indices[np.repeat(whole, topology.counts)]]
        rest = self.topology.triangles[~whole[polygon]]
        return Topology(
            np.concatenate([topology.counts[whole], np.full(len(rest), 3)]),
            np.concatenate([corners, rest.ravel()]),
            self.topology.n_points,
        )

    def spread(self, displacement: FloatArray) -> FloatArray:
        """Give every point of the frame the displacement (M, 3) of its welded vertex."""
        moved = displacement[np.maximum(self.new, 0)]
        moved[self.new < 0] = 0.0
        return moved
