"""Charts of a mesh: where a vertex that slid lies on the old surface, seam by seam."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.closest_in_triangle import closest_in_triangle, plane_weights
from meshmark.mesh.geometry import area_vectors, lengths, normalized, sum_at_corners
from meshmark.mesh.topology import face_adjacency, graph_components

# Triangles that a slide may cross; where normals disagree, a walk could go round in circles.
MOST_STEPS = 24
# Feet of perpendiculars this little outside of a triangle are inside.
INSIDE = -1e-9
# A chart is continued no farther beyond its edge than its triangle there is long.
FARTHEST = 4.0


@dataclass(frozen=True, eq=False)
class Charts:
    """Triangles over rows, which are vertices cut apart along seams.

    A vertex has a row for each chart about it; without seams, rows are vertices. Two triangles
    are in one chart where they share two rows.

    Parameters
    ----------
    triangles : (F, 3) int
        The row at each corner.
    vertices : (R,) int
        The vertex that each row belongs to.
    """

    triangles: IntArray
    vertices: IntArray

    @classmethod
    def whole(cls, F: IntArray, n_points: int) -> Charts:
        """Return those of a mesh without seams: a row for each of N vertices."""
        return cls(F, np.arange(n_points))

    @classmethod
    def of_corners(cls, F: IntArray, values: FloatArray) -> Charts:
        """Return those of a mesh with values (F, 3, k) at its corners, as `cut_along_seams` does.

        Corners are numbered triangle after triangle.
        """
        corners = np.arange(F.size).reshape(F.shape)
        same = equal_rows(values.reshape(F.size, -1))
        rows = cut_along_seams(F, corners, F.ravel(), same)
        return cls(rows[corners], F.ravel()[np.unique(rows, return_index=True)[1]])

    def of_rows(self, values: FloatArray) -> FloatArray:
        """Return what corners (F, 3, k) have in common, (R, k); 0 for a row without any."""
        found = np.zeros((len(self.vertices), values.shape[2]))
        found[self.triangles] = values
        return found

    @cached_property
    def faces(self) -> IntArray:
        """Triangles over vertices, (F, 3) int."""
        return self.vertices[self.triangles]

    @cached_property
    def _neighbours(self) -> IntArray:
        """Triangle across the side opposite each corner, (F, 3) int; -1 at the edge of a chart."""
        G = self.triangles
        pairs, shared = face_adjacency(G)
        found = np.full(G.shape, -1)
        for own, other in ((0, 1), (1, 0)):
            face = pairs[:, own]
            slots = [(G[face] == shared[:, [end]]).argmax(axis=1) for end in (0, 1)]
            found[face, 3 - slots[0] - slots[1]] = pairs[:, other]
        return found

    @cached_property
    def _used(self) -> NDArray[np.bool_]:
        """Which rows have triangles, (R,) bool."""
        return np.bincount(self.triangles.ravel(), minlength=len(self.vertices)) > 0

    def nearest(self, V: FloatArray, X: FloatArray, rows: IntArray) -> IntArray:
        """Find for each of some rows the triangle at it that is nearest to its new place."""
        number = np.full(len(self.vertices), -1)
        number[rows] = np.arange(len(rows))
        corner = np.flatnonzero(number[self.triangles.ravel()] >= 0)
        row, face = self.triangles.ravel()[corner], corner // 3
        P, (a, b, c) = X[self.vertices[row]], self._corners(V, face)
        weights, flat = plane_weights(P, a, b, c)
        # Not quite the closest point, but in no time, and near enough to begin with.
        weights = weights.clip(min=0)
        u, v, w = (weights / weights.sum(axis=1, keepdims=True)).T[:, :, None]
        off = np.where(flat, np.inf, lengths(u * a + v * b + w * c - P))
        order = np.lexsort([off, number[row]])
        return face[order[np.unique(number[row][order], return_index=True)[1]]]

    def places(self, V: FloatArray, X: FloatArray) -> Places:
        """Find where the moved vertices lie on the old surface, each row in its own chart.

        Parameters
        ----------
        V, X : (N, 3) float64
            The vertices before and after.

        Notes
        -----
        From the nearest triangle at the vertex, the walk goes on to the one across the side that
        the foot of the perpendicular lies beyond (a visibility walk), until the foot is inside. It
        looks at nothing but what a slide can reach: not at the other side of a thin sheet, nor at
        a hand that touches the body.
        """
        rows = np.flatnonzero(np.any(V != X, axis=1)[self.vertices] & self._used)
        face, P = self.nearest(V, X, rows), X[self.vertices[rows]]
        before = np.full(len(rows), -1)
        weights = np.zeros((len(rows), 3))
        beyond = np.zeros(len(rows), dtype=bool)
        active = np.arange(len(rows))
        for _ in range(MOST_STEPS):
            if active.size == 0:
                break
            here = face[active]
            w, flat = plane_weights(P[active], *self._corners(V, here))
            across = self._neighbours[here]
            outside = ~flat[:, None] & (w < INSIDE)
            weights[active] = w
            beyond[active] = (outside & (across < 0)).any(axis=1)
            # Not back where it came from: then the closest point is on the ridge between the two.
            ways = outside & (across >= 0) & (across != before[active, None])
            side = np.where(ways, w, 0.0).argmin(axis=1)
            onward = ways.any(axis=1)
            before[active] = here
            active = active[onward]
            face[active] = across[onward, side[onward]]
        far = np.abs(weights).max(axis=1, initial=0.0) > FARTHEST
        clamped = closest_in_triangle(P, *self._corners(V, face))
        continued = np.where((beyond & ~far)[:, None], weights, clamped)
        return Places(rows, self.triangles[face], clamped, continued, beyond)

    def _corners(self, V: FloatArray, face: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        a, b, c = (V[vertex] for vertex in self.faces[face].T)
        return a, b, c

    def normals(self, V: FloatArray) -> FloatArray:
        """Compute unit normals of the rows (R, 3), each of its own chart's triangles alone."""
        areas = area_vectors(V, self.faces)
        return normalized(sum_at_corners(areas, self.triangles, len(self.vertices)))


@dataclass(frozen=True, eq=False)
class Places:
    """Where rows lie on the old surface.

    Parameters
    ----------
    rows : (m,) int
        Those that moved.
    corners : (m, 3) int
        Rows at the corners of the triangle each lies in.
    clamped : (m, 3) float64
        Barycentric coordinates of the closest point there.
    continued : (m, 3) float64
        The same; beyond the edge of its chart, of the foot of the perpendicular on the triangle
        continued.
    beyond : (m,) bool
        Whether they are beyond the edge of their chart.
    """

    rows: IntArray
    corners: IntArray
    clamped: FloatArray
    continued: FloatArray
    beyond: NDArray[np.bool_]

    def values(self, values: FloatArray, *, continued: bool = False) -> FloatArray:
        """Interpolate values (R, k) of the rows at their places; those that did not move stay."""
        weights = self.continued if continued else self.clamped
        found = values.copy()
        found[self.rows] = np.einsum("mi,mik->mk", weights, values[self.corners])
        return found


@dataclass(frozen=True, eq=False)
class SlidPoints:
    """Points that slid over a surface without seams, and where they lie on the old one.

    Points that are the same in all respects stay together: they have one row.

    Parameters
    ----------
    charts : Charts
        Over the rows.
    kept : (R,) int
        A point of each row.
    rows : (N,) int
        The row of each point.
    before, after : (R, 3) float64
        The rows.
    """

    charts: Charts
    kept: IntArray
    rows: IntArray
    before: FloatArray
    after: FloatArray

    @classmethod
    def of(cls, F: IntArray, before: FloatArray, after: FloatArray, same: IntArray) -> SlidPoints:
        """Place points (N, 3); those with equal numbers `same` (N,) are one."""
        _, kept, rows = np.unique(same, return_index=True, return_inverse=True)
        rows = rows.reshape(-1)
        return cls(Charts.whole(rows[F], len(kept)), kept, rows, before[kept], after[kept])

    @cached_property
    def places(self) -> Places:
        """Where the rows lie."""
        return self.charts.places(self.before, self.after)

    def values(self, values: FloatArray) -> FloatArray:
        """Interpolate values (N, k) of the points at their places."""
        return self.places.values(values[self.kept])[self.rows]

    def turned(self, vectors: FloatArray) -> FloatArray:
        """Turn vectors (N, 3) at the places as the surface was turned."""
        there, here = self._normals
        return turned_along(vectors, there[self.rows], here[self.rows])

    @cached_property
    def _normals(self) -> tuple[FloatArray, FloatArray]:
        """Unit normals (R, 3): of the surface before at the places, and after."""
        there = self.places.values(self.charts.normals(self.before))
        return normalized(there), self.charts.normals(self.after)


def cut_along_seams(F: IntArray, corners: IntArray, vertices: IntArray, same: IntArray) -> IntArray:
    """Give each corner the number of its row: one for those about a vertex that no seam parts.

    Parameters
    ----------
    F, corners : (F, 3) int
        Vertices of the triangles, and which of C corners each is.
    vertices : (C,) int
        Vertex of each corner.
    same : (C,) int
        Equal for corners that have equal values.

    Returns
    -------
    (C,) int
        Row of each corner, in the order of the vertices.
    """
    _, G = np.unique(vertices * (int(same.max(initial=0)) + 1) + same, return_inverse=True)
    G = G.reshape(-1)[corners]
    pairs, shared = face_adjacency(G)
    joined = []
    for end in (0, 1):
        slots = [(G[pairs[:, k]] == shared[:, [end]]).argmax(axis=1) for k in (0, 1)]
        joined.append(np.stack([corners[pairs[:, k], slots[k]] for k in (0, 1)], axis=1))
    label = graph_components(np.concatenate(joined), len(vertices))
    first = np.unique(label, return_index=True)[1]
    order = np.argsort(vertices[first], kind="stable")
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    return number[label]


def equal_rows(values: NDArray[np.generic]) -> IntArray:
    """Return numbers (n,) int that are equal where rows (n, k) are."""
    number = np.zeros(len(values), dtype=np.int64)
    # Sorting numbers is several times quicker than sorting rows.
    for column in values.T:
        _, each = np.unique(column, return_inverse=True)
        code = number * (int(each.max(initial=0)) + 1) + each
        _, number = np.unique(code, return_inverse=True)
    return number.astype(np.int64)


def turned_along(vectors: FloatArray, before: FloatArray, after: FloatArray) -> FloatArray:
    """Turn vectors (n, 3) as unit vectors `before` turn to `after`, the shortest way.

    With v = a x b and c = a . b, x turns to c x + v x x + v (v . x) / (1 + c): Rodrigues' formula.
    Opposite directions have no shortest way; their vectors stay.
    """
    v, c = np.cross(before, after), np.einsum("ij,ij->i", before, after)[:, None]
    opposite = c < -1 + 1e-9
    along = np.einsum("ij,ij->i", v, vectors)[:, None] / np.where(opposite, 1.0, 1 + c)
    new = c * vectors + np.cross(v, vectors) + v * along
    known = np.any(before != 0, axis=1, keepdims=True) & np.any(after != 0, axis=1, keepdims=True)
    return np.where(opposite | ~known, vectors, new)
