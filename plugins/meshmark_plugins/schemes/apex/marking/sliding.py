"""What it costs to slide vertices: little along a surface, much where it bends or ends."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.geometry import area_vectors, lengths, normalized, sum_at_corners
from meshmark.mesh.remembered import read_only, remembered

# Spread of the normals about a vertex at which sliding costs twice what it costs on a plane.
REFERENCE_SPREAD = 0.003


class SlidingCost:
    """The cost of moving each vertex, by direction, in any pose of one triangulation.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.

    Notes
    -----
    With n the normals of the triangles about a vertex, n n^T averaged by area tells by how much
    a move leaves the planes of its neighbourhood. It is blind to one thing: at the rim of an ear
    or a fin, whose normals are n and -n, a vertex may slide inwards along both sides at once,
    and the rim is gone. So the edges count too, by b b^T, where b is the sum of the outward
    normals that their triangles have within their own planes. On a flat surface the two cancel,
    and on a bent one b lies along the normal and adds nothing new; at a rim, or on a border, b
    points outwards. Times their lengths, and summed over the edges about a vertex, it is twice the
    gradient of the area [1]_.

    References
    ----------
    .. [1] U. Pinkall, K. Polthier, "Computing discrete minimal surfaces and their conjugates",
       Experimental Mathematics 2(1), 1993. doi:10.1080/10586458.1993.10504266
    """

    def __init__(self, F: IntArray) -> None:
        self._F = F
        self._edges, self._edge_at = _edges_of_corners(F)

    def cost(self, V: FloatArray) -> FloatArray:
        """Cost of moving each vertex of V (N, 3), (N, 3, 3): 1 along planes, much more off them."""
        bend = both_spreads(V, self._F, self._edges, self._edge_at)
        return bend / REFERENCE_SPREAD + np.eye(3)

    def normal_spread(self, V: FloatArray) -> FloatArray:
        """Mean of n n^T over the triangles about each vertex, by area, (N, 3, 3).

        On a plane it is n n^T; the more the surface bends, the more of it lies in the tangents.
        """
        return _normal_spread(V, self._F)

    def rim_spread(self, V: FloatArray) -> FloatArray:
        """Mean of b b^T over the edges about each vertex, by area, (N, 3, 3).

        0 where the surface is flat; its trace is up to 8 / 3 where it turns back on itself.
        """
        return _rim_spread(V, self._F, self._edges, self._edge_at)


@remembered
def _edges_of_corners(F: IntArray) -> tuple[IntArray, IntArray]:
    """List vertices of edges (E, 2), and which edge follows each corner (3 F,)."""
    n = int(F.max(initial=0)) + 1
    half = np.sort(np.stack([F, np.roll(F, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    keys, edge_at = np.unique(half @ [n, 1], return_inverse=True)
    return read_only(np.stack(np.divmod(keys, n), axis=1)), read_only(edge_at)


@compiled
def both_spreads(V: FloatArray, F: IntArray, edges: IntArray, edge_at: IntArray) -> FloatArray:
    """Add what `SlidingCost` calls normal and rim spread, (N, 3, 3).

    Parameters
    ----------
    V, F
        Positions (N, 3) and triangles (F, 3).
    edges : (E, 2) int
        Vertices of each edge.
    edge_at : (3 F,) int
        Which edge follows each corner.
    """
    return _normal_spread(V, F) + _rim_spread(V, F, edges, edge_at)


def _normal_spread(V: FloatArray, F: IntArray) -> FloatArray:
    vectors = area_vectors(V, F)
    areas, n = lengths(vectors), normalized(vectors)
    return _mean(sum_at_corners(_outer(areas, n), F, len(V)), areas, F)


def _rim_spread(V: FloatArray, F: IntArray, edges: IntArray, edge_at: IntArray) -> FloatArray:
    vectors = area_vectors(V, F)
    areas, n = lengths(vectors), normalized(vectors)
    ahead = normalized((V[np.roll(F, -1, axis=1)] - V[F]).reshape(-1, 3))
    outward = np.cross(ahead, np.repeat(n, 3, axis=0))
    b = sum_at_corners(outward, edge_at[:, None], len(edges))
    # A third of a triangle's area belongs to each of its edges.
    share = sum_at_corners(np.repeat(areas / 3.0, 3), edge_at[:, None], len(edges))
    return _mean(sum_at_corners(_outer(share, b), edges, len(V)), areas, F)


def _mean(sums: FloatArray, areas: FloatArray, F: IntArray) -> FloatArray:
    about = np.maximum(sum_at_corners(areas, F, len(sums)), 1e-300)
    return (sums / about[:, None]).reshape(-1, 3, 3)


def _outer(weights: FloatArray, vectors: FloatArray) -> FloatArray:
    """Weighted outer products of vectors (n, 3) with themselves, (n, 9)."""
    outer: FloatArray = weights[:, None, None] * vectors[:, :, None] * vectors[:, None, :]
    return outer.reshape(-1, 9)
