"""Sparse matrices that act on vectors at vertices, vertex by vertex."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled


@dataclass(frozen=True, eq=False)
class VertexRows:
    """A sparse matrix (k, 3 N) as the vectors that its rows have at vertices.

    Parameters
    ----------
    starts : (k + 1,) int
        Where the vectors of each row begin.
    vertices : (B,) int
        At which vertex each vector is.
    vectors : (B, 3) float64
        Row after row.
    n_points : int
        N.
    """

    starts: IntArray
    vertices: IntArray
    vectors: FloatArray
    n_points: int

    @classmethod
    def stacked(cls, matrices: list[csr_matrix]) -> VertexRows:
        """Stack sparse matrices (k, 3 N) on each other."""
        starts, vertices, vectors = zip(*map(_by_vertex, matrices), strict=True)
        counts = np.concatenate([np.diff(each) for each in starts])
        return cls(
            np.concatenate([[0], np.cumsum(counts)]),
            np.concatenate(vertices).astype(np.int64),
            np.concatenate(vectors),
            matrices[0].shape[1] // 3,
        )

    def __matmul__(self, d: FloatArray) -> FloatArray:
        """Multiply vectors at vertices (3 N,) from the left, (k,)."""
        return row_products(self.starts, self.vertices, self.vectors, d)

    def sums(self, weights: FloatArray) -> FloatArray:
        """Sum the rows, each times its weight (k,), (3 N,)."""
        return row_sums(self.starts, self.vertices, self.vectors, weights, self.n_points)

    def squared(self, weights: FloatArray, d: FloatArray) -> FloatArray:
        """Multiply vectors (3 N,) by J^T diag(weights) J, where J is the matrix, (3 N,)."""
        return squared_product(self.starts, self.vertices, self.vectors, weights, d)


def _by_vertex(A: csr_matrix) -> tuple[IntArray, IntArray, FloatArray]:
    """Gather the entries of a matrix (k, 3 N) vertex by vertex; see `VertexRows`."""
    if _in_threes(A):
        return A.indptr // 3, A.indices[::3] // 3, A.data.reshape(-1, 3)
    B = A.tobsr((1, 3))
    return B.indptr, B.indices, B.data[:, 0]


def _in_threes(A: csr_matrix) -> bool:
    """Whether all three entries of a vertex follow each other wherever there are some."""
    first = A.indices[::3]
    if np.any(A.indptr % 3) or np.any(first % 3):
        return False
    return all(np.array_equal(A.indices[k::3], first + k) for k in (1, 2))


@compiled
def row_products(
    starts: IntArray, vertices: IntArray, vectors: FloatArray, d: FloatArray
) -> FloatArray:
    """Multiply vectors (3 N,) by `VertexRows` from the left, (k,)."""
    return block_matrix(starts, vertices, vectors, len(d) // 3) @ d


@compiled
def row_sums(
    starts: IntArray, vertices: IntArray, vectors: FloatArray, weights: FloatArray, n_points: int
) -> FloatArray:
    """Sum `VertexRows`, each times its weight (k,), (3 N,)."""
    return block_matrix(starts, vertices, vectors, n_points).T @ weights


@compiled
def squared_product(
    starts: IntArray, vertices: IntArray, vectors: FloatArray, weights: FloatArray, d: FloatArray
) -> FloatArray:
    """Multiply vectors (3 N,) by J^T diag(weights) J, where J is made of `VertexRows`, (3 N,)."""
    J = block_matrix(starts, vertices, vectors, len(d) // 3)
    return J.T @ (weights * (J @ d))


def block_matrix(
    starts: IntArray, vertices: IntArray, vectors: FloatArray, n_points: int
) -> bsr_matrix:
    """Build the matrix (k, 3 N) that `VertexRows` are, for scipy."""
    shape = (len(starts) - 1, 3 * n_points)
    return bsr_matrix((vectors[:, None, :], vertices, starts), shape=shape)
