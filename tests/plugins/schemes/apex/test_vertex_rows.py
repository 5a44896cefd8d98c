"""Sparse matrices as vectors at vertices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_matrix

from meshmark_plugins.schemes.apex.linear_algebra.vertex_rows import VertexRows, block_matrix

N = 9


def random_matrix(rng, share, in_threes):
    filled = rng.random((4, N if in_threes else 3 * N)) < share
    return rng.normal(size=(4, 3 * N)) * (np.repeat(filled, 3, axis=1) if in_threes else filled)


@pytest.mark.parametrize("in_threes", [True, False])
@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_they_act_as_the_matrices_stacked(share, in_threes):
    rng = np.random.default_rng(2)
    matrices = [random_matrix(rng, share, in_threes) for _ in range(3)]
    sparse = [csr_matrix(A) for A in matrices]
    # Vertices in any order.
    for A in sparse[1:]:
        for row in range(4):
            part = slice(*A.indptr[row : row + 2])
            if in_threes:
                turned = np.arange(A.nnz)[part].reshape(-1, 3)[::-1].ravel()
                A.indices[part], A.data[part] = A.indices[turned], A.data[turned]
    rows, J = VertexRows.stacked(sparse), np.concatenate(matrices)
    again = block_matrix(rows.starts, rows.vertices, rows.vectors, N)
    np.testing.assert_array_equal(again.toarray(), J)
    d, weights = rng.normal(size=3 * N), rng.normal(size=12)
    np.testing.assert_allclose(rows @ d, J @ d, atol=1e-12)
    np.testing.assert_allclose(rows.sums(weights), J.T @ weights, atol=1e-12)
    np.testing.assert_allclose(rows.squared(weights, d), J.T @ (weights * (J @ d)), atol=1e-12)
