"""Sparse factors: they solve, in any order, and a good order keeps them sparse."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import diags_array

from meshmark.mesh.factors import SymmetricFactor, elimination_order
from meshmark.mesh.geometry import vertex_areas
from meshmark.mesh.laplacian import cotangent_weights, stiffness_matrix
from meshmark.testing.meshes import torus


@pytest.fixture(scope="module")
def matrix():
    V, F = torus(60, 30)
    mass = diags_array(vertex_areas(V, F))
    return F, mass + stiffness_matrix(F, cotangent_weights(V, F), len(V))


@pytest.mark.parametrize("columns", [(), (3,)])
def test_a_factor_solves_with_an_order_and_without(matrix, columns):
    F, A = matrix
    x = np.random.default_rng(1).normal(size=(A.shape[0], *columns))
    order = elimination_order(F, A.shape[0])
    for factor in (SymmetricFactor(A), SymmetricFactor(A, order)):
        np.testing.assert_allclose(factor.solve(A @ x), x, atol=1e-9)


def test_an_elimination_order_keeps_factors_sparse(matrix):
    F, A = matrix
    n = A.shape[0]
    order = elimination_order(F, n)
    assert sorted(order.tolist()) == list(range(n))
    found, ordered, shuffled = (
        SymmetricFactor(A, rows)._factor.L.nnz
        for rows in (None, order, np.random.default_rng(2).permutation(n))
    )
    assert ordered == found < shuffled / 3


def test_a_singular_matrix_has_no_factor():
    F, n = torus(12, 8)[1], 96
    with pytest.raises(RuntimeError):
        SymmetricFactor(diags_array(np.zeros(n)), elimination_order(F, n))
