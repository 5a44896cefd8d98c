"""Where each vertex of a fine mesh lies on a coarse one that was sampled from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.mesh.closest_in_triangle import closest_on_edges
from meshmark.mesh.geometry import FLAT, lengths


def prolongation(
    V: FloatArray, samples: IntArray, faces: IntArray, nearest: IntArray
) -> csr_matrix:
    """Place each vertex in the closest triangle about its own sample.

    Not in the closest of all: across an ear, that is one of the other side.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions of the fine mesh.
    samples : (n,) int
        Vertices of the fine mesh that are those of the coarse one.
    faces : (f, 3) int
        Triangles of the coarse mesh, indices into `samples`; they use all.
    nearest : (N,) int
        The sample that each vertex belongs to.

    Returns
    -------
    (N, n) sparse float64
        Barycentric coordinates, three a row.
    """
    fans = _Fans.of(V, samples, faces)
    first, count = fans.first[nearest], fans.count[nearest]
    # A sample is a corner of all of its triangles; one will do.
    count[samples] = 1
    ways = np.ascontiguousarray((V - V[samples[nearest]]).T)
    squares, shares = np.full(len(V), np.inf), np.empty((3, len(V)))
    slots = first.copy()
    left: list[tuple[IntArray, IntArray, FloatArray]] = []
    # One triangle of each vertex at a time: all at once would take much memory.
    for turn in range(int(count.max())):
        rows = np.flatnonzero(count > turn)
        slot = first[rows] + turn
        feet, square, within = fans.feet(ways[:, rows], slot)
        nearer = square < squares[rows]
        found, unsure = np.flatnonzero(within & nearer), np.flatnonzero(nearer & ~within)
        at = rows[found]
        squares[at], shares[:, at], slots[at] = square[found], feet[:, found], slot[found]
        left.append((rows[unsure], slot[unsure], square[unsure]))
    rows, slot, bound = (np.concatenate(parts) for parts in zip(*left, strict=True))
    # Of most it is known by now that another one is closer.
    unsure = np.flatnonzero(bound < squares[rows])
    rows, slot = rows[unsure], slot[unsure]
    corners = [V[samples[corner]] for corner in fans.corners[:, slot]]
    exact = closest_on_edges(V[rows], *corners)
    square = lengths(sum(exact[:, k, None] * corners[k] for k in range(3)) - V[rows]) ** 2
    # Backwards and by distance, so that of those of a vertex the closest is the last.
    order = np.lexsort((-np.arange(len(rows)), -square))
    order = order[square[order] < squares[rows[order]]]
    at = rows[order]
    shares[:, at], slots[at] = exact[order].T, slot[order]
    start = 3 * np.arange(len(V) + 1)
    indices = fans.corners[:, slots].T.ravel()
    return csr_matrix((shares.T.ravel(), indices, start), shape=(len(V), len(samples)))


@dataclass(frozen=True, eq=False)
class _Fans:
    """The triangles about each vertex of a coarse mesh: one slot for each corner of a triangle.

    Parameters
    ----------
    corners : (3, 3 f) int
        The corners of the triangle, the vertex whose slot it is first.
    duals : (9, 3 f) float64
        Three vectors. Their products with the way from the vertex to a point are the second and
        the third barycentric coordinate of the foot of the perpendicular, and its length.
    heights : (3, 3 f) float64
        Height over the side opposite to each corner; all 0 in triangles without area.
    first, count : (n,) int
        The first slot of each vertex, and how many it has.
    """

    corners: IntArray
    duals: FloatArray
    heights: FloatArray
    first: IntArray
    count: IntArray

    @classmethod
    def of(cls, V: FloatArray, samples: IntArray, faces: IntArray) -> _Fans:
        """Sort triangles by their corners; parameters are those of `prolongation`."""
        face, turn = np.divmod(np.argsort(faces.ravel(), kind="stable"), 3)
        corners = np.stack([faces[face, (turn + k) % 3] for k in range(3)])
        a, b, c = (np.ascontiguousarray(V[samples[corner]].T) for corner in corners)
        u, v = b - a, c - a
        uu, uv, vv = (u * u).sum(axis=0), (u * v).sum(axis=0), (v * v).sum(axis=0)
        determinant = uu * vv - uv**2
        flat = determinant <= FLAT * uu * vv
        safe = np.where(flat, 1.0, determinant)
        second, third = (vv * u - uv * v) / safe, (uu * v - uv * u) / safe
        normal = np.cross(u, v, axis=0) / np.sqrt(safe)
        slopes = [(x * x).sum(axis=0) for x in (second + third, second, third)]
        heights = np.where(flat, 0.0, 1.0 / np.sqrt(np.where(flat, 1.0, slopes)))
        duals = np.where(flat, 0.0, np.concatenate([second, third, normal]))
        count = np.bincount(faces.ravel(), minlength=len(samples))
        return cls(corners, duals, heights, np.cumsum(count) - count, count)

    def feet(self, ways: FloatArray, slot: IntArray) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Drop perpendiculars on triangles.

        Parameters
        ----------
        ways : (3, k) float64
            The way to each point from the vertex whose slot it is.
        slot : (k,) int
            Slots.

        Returns
        -------
        shares : (3, k) float64
            Barycentric coordinates of the feet.
        square : (k,) float64
            Squared distance from the triangle; where the foot lies outside, it is at least that.
        within : (k,) bool
            Whether the foot lies in the triangle.
        """
        x, y, z = ways
        dual = self.duals[:, slot]
        second, third, rise = (dual[i] * x + dual[i + 1] * y + dual[i + 2] * z for i in (0, 3, 6))
        shares = np.stack([1.0 - second - third, second, third])
        heights = self.heights[:, slot]
        beyond = np.maximum(0.0, (-shares * heights).max(axis=0))
        within = (shares.min(axis=0) >= 0.0) & (heights[0] > 0.0)
        return shares, rise**2 + beyond**2, within
