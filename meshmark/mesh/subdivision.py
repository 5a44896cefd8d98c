"""Subdivision as linear maps: new points are weighted sums of old ones.

An edge with other than two faces, or between faces of opposite orientation, is a border, where
every rule works along the edge only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix, diags_array, eye_array, vstack

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.mesh.topology import Topology

# A cubic spline's vertex moves 1/6 towards each neighbour in the limit, and 1/8 in one step.
OF_A_SPLINE = 4 / 3

Rule = Callable[[Topology], tuple[csr_matrix, Topology]]


def midpoint(topology: Topology) -> tuple[csr_matrix, Topology]:
    """Put a point in the middle of every edge: four triangles where there was one.

    Parameters
    ----------
    topology : Topology
        Polygons over N points; their triangles are subdivided.

    Returns
    -------
    weights : (N + E, N) sparse
        Old points first, then one for each edge.
    topology : Topology
        Four times as many triangles, over the new points.
    """
    F, n_points = topology.triangles, topology.n_points
    edges = _Edges.of(F, n_points)
    halves = _rows(edges.ends, 0.5, n_points)
    return _result([eye_array(n_points), halves], _quarters(F, edges))


def loop(topology: Topology) -> tuple[csr_matrix, Topology]:
    """Apply Loop's rule; see `midpoint` for the shapes.

    An inner edge's point is 3/8 of its ends and 1/8 of the corners across; an inner vertex with
    n neighbours keeps 1 - n b of itself, b = (5/8 - (3/8 + cos(2 pi / n) / 4)^2) / n. Borders
    are cubic splines.

    References
    ----------
    C. T. Loop, "Smooth subdivision surfaces based on triangles", MSc thesis, University of
    Utah, 1987.
    """
    F, n_points = topology.triangles, topology.n_points
    edges = _Edges.of(F, n_points)
    # Each face gives the edge opposite to a corner that corner.
    across = csr_matrix(
        (np.ones(F.size), (edges.of_side, F[:, [2, 0, 1]].ravel())),
        shape=(len(edges.ends), n_points),
    )
    edge_points = (
        diags_array(np.where(edges.inner, 0.375, 0.5)) @ _rows(edges.ends, 1.0, n_points)
        + diags_array(np.where(edges.inner, 0.125, 0.0)) @ across
    )
    A, degree, fixed = edges.neighbours()
    share = np.where(fixed | (degree == 0), 0.0, _loop_share(np.maximum(degree, 1)))
    vertex_points = diags_array(1.0 - share * degree) @ eye_array(n_points) + diags_array(share) @ A
    vertex_points = vertex_points + edges.border_smoothing()
    return _result([vertex_points, edge_points], _quarters(F, edges))


def sqrt3(topology: Topology) -> tuple[csr_matrix, Topology]:
    """Apply Kobbelt's rule: a point in every face, inner edges flipped, inner vertices relaxed.

    A vertex with n neighbours moves to (1 - a) of itself and a of their mean,
    a = (4 - 2 cos(2 pi / n)) / 9. Borders stay.

    Returns
    -------
    weights : (N + F, N) sparse
        Old points first, then one for each triangle.
    topology : Topology
        Three times as many triangles, over the new points.

    References
    ----------
    L. Kobbelt, "sqrt(3)-subdivision", SIGGRAPH 2000. doi:10.1145/344779.344835
    """
    F, n_points = topology.triangles, topology.n_points
    edges = _Edges.of(F, n_points)
    A, degree, fixed = edges.neighbours()
    n = np.maximum(degree, 1)
    alpha = np.where(fixed | (degree == 0), 0.0, (4.0 - 2.0 * np.cos(2 * np.pi / n)) / 9.0)
    vertex_points = diags_array(1.0 - alpha) + diags_array(alpha / n) @ A
    return _result([vertex_points, _rows(F, 1 / 3, n_points)], _flipped(F, edges))


def catmull_clark(topology: Topology) -> tuple[csr_matrix, Topology]:
    """Apply the rule of Catmull and Clark: a quad at every corner of every polygon.

    A face's point is the mean of its corners; an inner edge's the mean of its ends and of the
    two faces' points; an inner vertex with n neighbours keeps (n - 2) / n of itself, and takes
    1 / n of the mean of its neighbours and of the mean of its faces' points. Borders are cubic
    splines, but a corner of one face alone stays, as in USD's default "edgeAndCorner".

    Returns
    -------
    weights : (N + E + P, N) sparse
        Old points first, then one for each edge, then one for each polygon.
    topology : Topology
        As many quads as there were corners.

    References
    ----------
    E. Catmull, J. Clark, "Recursively generated B-spline surfaces on arbitrary topological
    meshes", Computer-Aided Design 10(6), 1978. doi:10.1016/0010-4485(78)90110-0
    """
    counts, corners, n_points = topology.counts, topology.indices, topology.n_points
    face = np.repeat(np.arange(len(counts)), counts)
    following = _following(counts)
    edges = _Edges.between(corners, corners[following], n_points)
    face_points = csr_matrix((1.0 / counts[face], (face, corners)), shape=(len(counts), n_points))
    faces_of_edge = csr_matrix(
        (np.ones(len(face)), (edges.of_side, face)), shape=(len(edges.ends), len(counts))
    )
    edge_points = (
        diags_array(np.where(edges.inner, 0.25, 0.5)) @ _rows(edges.ends, 1.0, n_points)
        + diags_array(np.where(edges.inner, 0.25, 0.0)) @ faces_of_edge @ face_points
    )
    A, degree, fixed = edges.neighbours()
    faces_of_vertex = csr_matrix(
        (np.ones(len(face)), (corners, face)), shape=(n_points, len(counts))
    )
    free = ~fixed & (degree > 0)
    n = np.maximum(degree, 1)
    square = diags_array(np.where(free, 1.0 / n**2, 0.0))
    of_itself = np.where(free, (n - 2.0) / n, 1.0)
    curve = np.bincount(corners, minlength=n_points) > 1
    vertex_points = (
        diags_array(of_itself)
        + square @ A
        + square @ faces_of_vertex @ face_points
        + diags_array(curve.astype(np.float64)) @ edges.border_smoothing()
    )
    side = edges.of_side + n_points
    before = np.empty_like(following)
    before[following] = np.arange(len(following))
    quads = np.stack([corners, side, face + n_points + len(edges.ends), side[before]], axis=1)
    return _result([vertex_points, edge_points, face_points], quads)


RULES: dict[str, Rule] = {
    "midpoint": midpoint,
    "loop": loop,
    "sqrt3": sqrt3,
    "catmull_clark": catmull_clark,
}


def subdivide(topology: Topology, rule: str, steps: int) -> tuple[csr_matrix, Topology]:
    """Apply one of `RULES` again and again.

    Returns
    -------
    weights : (M, N) sparse
        New points as sums of old ones.
    topology : Topology
        Over the M new points.
    """
    W = csr_matrix(eye_array(topology.n_points))
    for _ in range(steps):
        step, topology = RULES[rule](topology)
        W = csr_matrix(step @ W)
    return W, topology


def loop_limit(topology: Topology) -> csr_matrix:
    """Weigh the points that `loop`, applied for ever, would take the points to.

    An inner vertex with n neighbours keeps 1 - n c of itself, and takes c of each,
    c = 1 / (n + 3 / (8 b)), with b as in `loop`. Borders are cubic splines.

    Returns
    -------
    (N, N) sparse
        Points on the limit surface as sums of the points given.

    References
    ----------
    C. T. Loop, "Smooth subdivision surfaces based on triangles", MSc thesis, University of
    Utah, 1987.
    """
    n_points = topology.n_points
    edges = _Edges.of(topology.triangles, n_points)
    A, degree, fixed = edges.neighbours()
    n = np.maximum(degree, 1)
    share = np.where(fixed | (degree == 0), 0.0, 1.0 / (n + 0.375 / _loop_share(n)))
    inner = diags_array(1.0 - n * share) @ eye_array(n_points) + diags_array(share) @ A
    return csr_matrix(inner + OF_A_SPLINE * edges.border_smoothing())


def catmull_clark_limit(topology: Topology) -> csr_matrix:
    """Weigh the points that `catmull_clark`, applied for ever, would take the points to.

    An inner vertex with n neighbours takes n^2 of itself, 4 of each, and 1 of each corner across a
    face, over n (n + 5). Borders are as in `catmull_clark`.

    Parameters
    ----------
    topology : Topology
        Quads: what one step of `catmull_clark` makes.

    Returns
    -------
    (N, N) sparse
        Points on the limit surface as sums of the points given.

    References
    ----------
    M. Halstead, M. Kass, T. DeRose, "Efficient, fair interpolation using Catmull-Clark surfaces",
    SIGGRAPH 1993. doi:10.1145/166117.166121
    """
    corners, n_points = topology.indices, topology.n_points
    edges = _Edges.between(corners, corners[_following(topology.counts)], n_points)
    A, degree, fixed = edges.neighbours()
    quads = corners.reshape(-1, 4)
    across = csr_matrix(
        (np.ones(quads.size), (quads.ravel(), np.roll(quads, 2, axis=1).ravel())),
        shape=(n_points, n_points),
    )
    n = np.maximum(degree, 1)
    share = np.where(fixed | (degree == 0), 0.0, 1.0 / (n * (n + 5.0)))
    inner = diags_array(1.0 - 5.0 * n * share) @ eye_array(n_points)
    inner = inner + diags_array(share) @ (4.0 * A + across)
    curve = np.bincount(corners, minlength=n_points) > 1
    return csr_matrix(
        inner + OF_A_SPLINE * diags_array(curve.astype(float)) @ edges.border_smoothing()
    )


LIMITS: dict[str, Callable[[Topology], csr_matrix]] = {
    "loop": loop_limit,
    "catmull_clark": catmull_clark_limit,
}


def _loop_share(n: IntArray) -> FloatArray:
    """Return b of `loop`, for vertices with n neighbours."""
    share: FloatArray = (0.625 - (0.375 + 0.25 * np.cos(2 * np.pi / n)) ** 2) / n
    return share


@dataclass(frozen=True, eq=False)
class _Edges:
    """The edges of polygons, each once.

    Parameters
    ----------
    ends : (E, 2) int
    of_side : (S,) int
        The edge that each side of each polygon is.
    inner : (E,) bool
        Whether just two polygons share it, which agree about outside.
    n_points : int
    """

    ends: IntArray
    of_side: IntArray
    inner: BoolArray
    n_points: int

    @classmethod
    def of(cls, F: IntArray, n_points: int) -> _Edges:
        """List the edges of triangles; their sides are ab, bc, ca."""
        return cls.between(F.ravel(), F[:, [1, 2, 0]].ravel(), n_points)

    @classmethod
    def between(cls, start: IntArray, end: IntArray, n_points: int) -> _Edges:
        """List the edges of polygons whose sides (S,) run from start to end."""
        half = np.sort(np.stack([start, end], axis=1), axis=1)
        ends, of_side, uses = np.unique(half, axis=0, return_inverse=True, return_counts=True)
        of_side = of_side.reshape(-1)
        forward = np.bincount(of_side[start < end], minlength=len(ends))
        return cls(ends, of_side, (uses == 2) & (forward == 1), n_points)

    def neighbours(self) -> tuple[csr_matrix, IntArray, BoolArray]:
        """Build the one-ring matrix, its row sums, and which vertices lie on a border."""
        A = _symmetric(self.ends, self.n_points)
        fixed = np.zeros(self.n_points, dtype=bool)
        fixed[self.ends[~self.inner].ravel()] = True
        return A, np.bincount(self.ends.ravel(), minlength=self.n_points), fixed

    def border_smoothing(self) -> csr_matrix:
        """Build what moves a border vertex by 1/8 towards each of its two border neighbours."""
        border = self.ends[~self.inner]
        # Where borders meet or end there is no curve to smooth.
        uses = np.bincount(border.ravel(), minlength=self.n_points)
        curve = np.where(uses == 2, 0.125, 0.0)
        A = _symmetric(border, self.n_points)
        return csr_matrix(diags_array(curve) @ A - diags_array(2.0 * curve))


def _symmetric(pairs: IntArray, n_points: int) -> csr_matrix:
    i, j = np.concatenate([pairs, pairs[:, ::-1]]).T
    return csr_matrix((np.ones(len(i)), (i, j)), shape=(n_points, n_points))


def _rows(columns: IntArray, weight: float, n_points: int) -> csr_matrix:
    """Build a matrix whose row i has the weight in the given columns."""
    n, k = columns.shape
    place = (np.repeat(np.arange(n), k), columns.ravel())
    return csr_matrix((np.full(n * k, weight), place), shape=(n, n_points))


def _following(counts: IntArray) -> IntArray:
    """Find the corner that follows each corner of its polygon."""
    ends = np.cumsum(counts)
    following = np.arange(1, int(ends[-1]) + 1)
    following[ends - 1] = ends - counts
    return following


def _result(points: list[csr_matrix], polygons: IntArray) -> tuple[csr_matrix, Topology]:
    W = csr_matrix(vstack(points))
    n, k = polygons.shape
    return W, Topology(np.full(n, k), polygons.ravel(), W.shape[0])


def _quarters(F: IntArray, edges: _Edges) -> IntArray:
    """Cut triangles in four, at a point on each edge."""
    a, b, c = F.T
    ab, bc, ca = (edges.of_side.reshape(-1, 3) + edges.n_points).T
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.stack([np.stack(quarter, axis=1) for quarter in quarters], axis=1).reshape(-1, 3)


def _flipped(F: IntArray, edges: _Edges) -> IntArray:
    """Connect face points across inner edges, and to the ends of borders."""
    start, end, edge = F.ravel(), F[:, [1, 2, 0]].ravel(), edges.of_side
    centre = np.repeat(np.arange(len(F)), 3) + edges.n_points
    order = np.argsort(edge, kind="stable")
    order = order[edges.inner[edge[order]]]
    # Sorted by edge, the two sides of an inner edge lie one after the other.
    one, two = order[0::2], order[1::2]
    across = np.full(len(start), -1)
    across[one], across[two] = centre[two], centre[one]
    # A side a -> b makes (a, other face's point, own point); its twin makes b's.
    third = np.where(across >= 0, across, end)
    return np.stack([start, third, centre], axis=1)
