"""The inverse of blocks and rows."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.sparse import csr_matrix

from meshmark_plugins.schemes.apex.linear_algebra.block_woodbury import BlockWoodbury, MeanRows
from meshmark_plugins.schemes.apex.linear_algebra.vertex_rows import VertexRows

N, K = 7, 4


def random_blocks(rng):
    halves = rng.normal(size=(N, 3, 3))
    return halves @ np.swapaxes(halves, 1, 2) + np.eye(3)


def mean_rows(matrices):
    return MeanRows(VertexRows.stacked(list(map(csr_matrix, matrices))), K)


@pytest.mark.parametrize("poses", [1, 3])
def test_it_is_the_inverse_where_all_poses_ask_for_the_same(poses):
    rng = np.random.default_rng(poses)
    blocks, weights = random_blocks(rng), rng.random((poses, K))
    weights[:, 1] = 0.0
    J = rng.normal(size=(K, 3 * N)) * (rng.random((K, 3 * N)) < 0.4)
    A = block_diag(*blocks) + J.T @ (weights.sum(axis=0)[:, None] * J)
    inverse = BlockWoodbury(blocks, mean_rows([J] * poses), weights)
    d = rng.normal(size=3 * N)
    np.testing.assert_allclose(inverse(A @ d), d, atol=1e-10)


def test_of_different_poses_it_takes_the_mean():
    rng = np.random.default_rng(5)
    blocks, weights = random_blocks(rng), rng.uniform(0.5, 1.0, (2, K))
    both = [rng.normal(size=(K, 3 * N)) * (rng.random((K, 3 * N)) < 0.4) for _ in range(2)]
    total = weights.sum(axis=0)[:, None]
    mean = sum(w[:, None] * J for w, J in zip(weights, both, strict=True)) / total
    A = block_diag(*blocks) + mean.T @ (total * mean)
    inverse = BlockWoodbury(blocks, mean_rows(both), weights)
    d = rng.normal(size=3 * N)
    np.testing.assert_allclose(inverse(A @ d), d, atol=1e-10)


def test_without_weights_blocks_alone_are_inverted():
    rng = np.random.default_rng(6)
    blocks, r = random_blocks(rng), rng.normal(size=3 * N)
    rows = mean_rows([rng.normal(size=(K, 3 * N))])
    found = BlockWoodbury(blocks, rows, np.zeros((1, K)))(r)
    np.testing.assert_allclose(block_diag(*blocks) @ found, r, atol=1e-12)
