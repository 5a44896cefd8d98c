"""One displacement of the reference surface, as it lies in other poses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import Frame
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.deformation import Deformation
from meshmark.mesh.flip_guard import allowed_shares
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.proxy import Proxy
from meshmark.mesh.surface_walk import WALK_TOLERANCE
from meshmark.mesh.topology import Topology, face_components, faces_about_vertices
from meshmark.mesh.triangle_search import search_order

# Way, in moves, over which moves grow about a vertex that must not move: a third of their length
# an own length, which is far from turning a face over.
RAMP = 3.0


@dataclass(frozen=True, eq=False)
class DisplacementTransfer:
    """Transfers displacements of a reference frame, in its root areas, to other frames.

    Parameters
    ----------
    V : (N, 3) float64
        Positions of the reference frame.
    F : (F, 3) int
        Triangles of all frames.
    proxy : Proxy, optional
        What displacements are given on; by default, the mesh itself.
    """

    V: FloatArray
    F: IntArray
    proxy: Proxy | None = None

    @cached_property
    def root_area(self) -> float:
        """Square root of the reference frame's area."""
        return float(np.sqrt(face_areas(self.V, self.F).sum()))

    @cached_property
    def label(self) -> IntArray:
        """Edge-connected component of each triangle, (F,) int."""
        return face_components(self.F)

    @cached_property
    def surface(self) -> tuple[FloatArray, IntArray]:
        """Positions in the reference frame (n, 3), and triangles, of what is displaced."""
        return self.positions(self.V), self.F if self.proxy is None else self.proxy.faces

    @cached_property
    def deformation(self) -> Deformation:
        """How what is displaced turns and stretches from the reference to other frames."""
        return Deformation(*self.surface)

    def positions(self, P: FloatArray) -> FloatArray:
        """Positions of what is displaced, (n, 3), in a frame whose vertices are at P (N, 3)."""
        return P if self.proxy is None else self.proxy.fit(P)

    def displaced(self, frame: Frame) -> Frame:
        """Return what is displaced, as it lies in another frame."""
        return Frame(frame.time, self.positions(frame.points), self._topology)

    @cached_property
    def _topology(self) -> Topology:
        return Topology.from_triangles(self.surface[1], len(self.surface[0]))

    @cached_property
    def _faces(self) -> IntArray:
        """A triangle of each vertex, to walk from, (N,); of those without any, the first of all."""
        start, about = faces_about_vertices(self.F)
        faces, used = np.zeros(len(self.V), dtype=np.int64), np.flatnonzero(np.diff(start))
        faces[used] = about[start[used]]
        return faces

    @cached_property
    def order(self) -> IntArray | None:
        """The `search_order` of the triangles."""
        return search_order(self.V, self.F)

    def closest_points(self, P: FloatArray) -> ClosestPoints:
        """Build the surface of another frame, to lie on."""
        return ClosestPoints(P, self.F, self.order)

    def apply(
        self,
        P: FloatArray,
        d: FloatArray,
        original: ClosestPoints,
        shares: FloatArray | float = 1.0,
    ) -> tuple[FloatArray, FloatArray, IntArray]:
        """Apply a displacement (3 n,) to another frame, and lay it on that frame's surface.

        Parameters
        ----------
        P : (N, 3) float64
            Positions of the frame.
        d : (3 n,) float64
            The displacement, in root areas of the reference frame.
        original : ClosestPoints
            The frame's surface.
        shares : (N,) float64, optional
            How much of its move is left to each vertex from the start.

        Returns
        -------
        X : (N, 3) float64
            Positions on the surface P, no face turned over.
        share : (N,) float64
            How much of its move that left each vertex.
        face : (N,) int
            The triangle of the surface that its whole move would end in.
        """
        moved = P + self.moves(P, d, shares)
        tolerance = WALK_TOLERANCE * np.sqrt(face_areas(P, self.F))[self._faces]
        face = original.faces_near(moved, self._faces, tolerance)
        wanted = original.points_in(face, moved)
        share = allowed_shares(P, wanted, self.F, np.inf, ramp=RAMP)
        return P + share[:, None] * (wanted - P), share, face

    def moves(self, P: FloatArray, d: FloatArray, shares: FloatArray | float = 1.0) -> FloatArray:
        """Carry a displacement to another frame: moves of its vertices, (N, 3); see `apply`."""
        moves = self.root_area * self.deformation.carry(d.reshape(-1, 3), self.positions(P))
        if self.proxy is not None:
            moves = self.proxy.prolongation @ moves
        return np.reshape(shares, (-1, 1)) * moves
