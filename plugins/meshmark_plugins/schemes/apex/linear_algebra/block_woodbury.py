"""The inverse of a block diagonal matrix and a few rows squared."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import bsr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark_plugins.schemes.apex.linear_algebra.vertex_rows import VertexRows


class MeanRows:
    """Weighted means of the rows that several matrices have in common.

    Parameters
    ----------
    rows : VertexRows
        The matrices J_p (k, 3 N), one after the other.
    n_rows : int
        k.

    Attributes
    ----------
    begins : (N + 1,) int
        Where the vectors of each vertex begin.
    means : (B,) int
        Of which mean each vector is.
    n_rows : int
        k.
    """

    def __init__(self, rows: VertexRows, n_rows: int) -> None:
        self._rows, self.n_rows = rows, n_rows
        self.begins, self.means, self._places = places_at_vertices(
            rows.starts, rows.vertices, n_rows, rows.n_points
        )

    def vectors(self, shares: FloatArray) -> FloatArray:
        """Add up the matrices' rows times their shares (P, k), (B, 3), vertex after vertex."""
        rows, n_vectors = self._rows, len(self.means)
        return sums_at_places(rows.starts, rows.vectors, self._places, shares.ravel(), n_vectors)


class BlockWoodbury:
    """Approximates the inverse of D + sum over p of J_p^T diag(w_p) J_p, by few rows.

    Matrices J_p that have much in common are taken for their weighted mean M, so that the
    Woodbury identity asks for no more rows than one of them has.

    Parameters
    ----------
    blocks : (N, 3, 3) float64
        The blocks of D, symmetric positive definite.
    rows : MeanRows
        Of the matrices J_p (k, 3 N).
    weights : (P, k) float64
        w_p, not negative.
    """

    def __init__(self, blocks: FloatArray, rows: MeanRows, weights: FloatArray) -> None:
        # Times the root of its weight, the mean of a row without any is none.
        root = np.sqrt(weights.sum(axis=0))
        shares = np.divide(weights, root, out=np.zeros_like(weights), where=root > 0.0)
        self._inverse, self._n_rows = inverted_blocks(blocks), rows.n_rows
        self._mean = rows.begins, rows.means, rows.vectors(shares)
        small = small_matrix(*self._mean, self._inverse, rows.n_rows)
        self._factor = cho_factor(np.eye(rows.n_rows) + small)

    def __call__(self, r: FloatArray) -> FloatArray:
        """Multiply vectors (3 N,) by the inverse."""
        seen = seen_by_rows(*self._mean, self._inverse, r, self._n_rows)
        return corrected(*self._mean, self._inverse, r, cho_solve(self._factor, seen))


@compiled
def inverted_blocks(blocks: FloatArray) -> FloatArray:
    """Invert symmetric positive definite matrices (N, 3, 3)."""
    return np.linalg.inv(blocks).astype(np.float64, copy=False)


@compiled
def places_at_vertices(
    starts: IntArray, vertices: IntArray, n_rows: int, n_points: int
) -> tuple[IntArray, IntArray, IntArray]:
    """Find a place for what matrices of `n_rows` `VertexRows` have at vertices, row by row.

    Returns
    -------
    begins, means
        As of `MeanRows`.
    places : (b,) int
        Where each vector of the matrices belongs.
    """
    row = np.repeat(np.arange(len(starts) - 1) % n_rows, np.diff(starts))
    codes, places = np.unique(vertices * n_rows + row, return_inverse=True)
    begins = np.searchsorted(codes, n_rows * np.arange(n_points + 1))
    return begins, codes % n_rows, places


@compiled
def sums_at_places(
    starts: IntArray, vectors: FloatArray, places: IntArray, shares: FloatArray, n_places: int
) -> FloatArray:
    """Add up the vectors (b, 3) of `VertexRows`, times the shares of their rows, (B, 3)."""
    weighted = np.repeat(shares, np.diff(starts))[:, None] * vectors
    return np.stack([np.bincount(places, x, n_places) for x in weighted.T], axis=1)


@compiled
def small_matrix(
    begins: IntArray, means: IntArray, vectors: FloatArray, inverse: FloatArray, n_rows: int
) -> FloatArray:
    """Compute M D^-1 M^T (k, k), from M by vertex and the inverse blocks (N, 3, 3)."""
    M = _by_vertex(begins, means, vectors, n_rows)
    return np.asarray((M.T @ _diagonal(inverse) @ M).todense())


@compiled
def seen_by_rows(
    begins: IntArray,
    means: IntArray,
    vectors: FloatArray,
    inverse: FloatArray,
    r: FloatArray,
    n_rows: int,
) -> FloatArray:
    """Compute M D^-1 r (k,)."""
    return _by_vertex(begins, means, vectors, n_rows).T @ (_diagonal(inverse) @ r)


@compiled
def corrected(
    begins: IntArray,
    means: IntArray,
    vectors: FloatArray,
    inverse: FloatArray,
    r: FloatArray,
    weights: FloatArray,
) -> FloatArray:
    """Compute D^-1 (r - M^T weights) (3 N,)."""
    M = _by_vertex(begins, means, vectors, len(weights))
    return _diagonal(inverse) @ (r - M @ weights)


def _by_vertex(begins: IntArray, means: IntArray, vectors: FloatArray, n_rows: int) -> bsr_matrix:
    """Build M^T (3 N, k)."""
    shape = (3 * (len(begins) - 1), n_rows)
    return bsr_matrix((vectors[:, :, None], means, begins), shape=shape)


def _diagonal(blocks: FloatArray) -> bsr_matrix:
    n = len(blocks)
    return bsr_matrix((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n))
