"""Which of many triangles is closest to a point: a tree of boxes, or open3d's."""

from __future__ import annotations

from types import ModuleType
from typing import Protocol

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import load_loops, plain
from meshmark.mesh.open3d_import import load_open3d

TREE_LOOPS = "meshmark.mesh.tree_loops"


class TriangleSearch(Protocol):
    """Built once on triangles, asked many times which is closest."""

    def closest(self, Q: FloatArray) -> IntArray:
        """Find the triangle that is closest to each query (n, 3), (n,)."""


def triangle_search(V: FloatArray, F: IntArray, order: IntArray | None = None) -> TriangleSearch:
    """Build a search among triangles F (F, 3), at least one, with vertices V (N, 3).

    Coordinates should be about 1: open3d, which stands in where numba is missing, searches in
    single precision. `order` is the triangles' `search_order` in any pose.
    """
    loops = load_loops(TREE_LOOPS)
    return TriangleScene(V, F) if loops is None else TriangleTree(loops, V, F, order)


def search_order(V: FloatArray, F: IntArray) -> IntArray | None:
    """Order triangles so that neighbours in space follow each other; None where it is not used."""
    loops = load_loops(TREE_LOOPS)
    if loops is None:
        return None
    a, b, c = (V[corner] for corner in F.T)
    return loops.tree_order(plain((a + b + c).T), _count_leaves(loops, F))


class TriangleTree:
    """A complete binary tree of bounding boxes, exact but for rounding.

    Parameters
    ----------
    loops : module
        Compiled.
    V, F, order
        See `triangle_search`.

    Notes
    -----
    Of triangles that are equally close, as those about an edge or a vertex often are, the first
    one counts, whatever their order in the tree. So that may come from another pose.
    """

    def __init__(
        self, loops: ModuleType, V: FloatArray, F: IntArray, order: IntArray | None
    ) -> None:
        self._loops = loops
        self._order = search_order(V, F) if order is None else order
        self._corners = plain(V[F[self._order]].reshape(-1, 9))
        self._boxes = loops.tree_boxes(self._corners, _count_leaves(loops, F))

    def closest(self, Q: FloatArray) -> IntArray:
        """See `TriangleSearch`."""
        return self._loops.closest_triangles(self._corners, self._boxes, self._order, plain(Q))


class TriangleScene:
    """open3d's tree, in single precision; see `triangle_search`."""

    def __init__(self, V: FloatArray, F: IntArray) -> None:
        self._scene = load_open3d().t.geometry.RaycastingScene()
        self._scene.add_triangles(V.astype(np.float32), np.ascontiguousarray(F, dtype=np.uint32))

    def closest(self, Q: FloatArray) -> IntArray:
        """See `TriangleSearch`."""
        answer = self._scene.compute_closest_points(Q.astype(np.float32))
        return answer["primitive_ids"].numpy().astype(np.int64)


def _count_leaves(loops: ModuleType, F: IntArray) -> int:
    """Count the leaves of a complete tree of triangles: the next power of two."""
    return 1 << max(0, -(-len(F) // loops.LEAF) - 1).bit_length()
