"""Conjugate gradients against elimination."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from meshmark_plugins.schemes.apex.linear_algebra.conjugate_gradients import conjugate_gradients


def definite(rng, n):
    A = rng.normal(size=(n, n))
    return A @ A.T + np.diag(rng.uniform(0.5, 50.0, n))


@given(st.integers(0, 2**32 - 1), st.integers(1, 30))
def test_conjugate_gradients_agree_with_elimination(seed, n):
    rng = np.random.default_rng(seed)
    A, b, x = definite(rng, n), rng.normal(size=n), rng.normal(size=n)
    wanted = np.linalg.solve(A, b)
    by_diagonal = conjugate_gradients(A, b, x, 1.0 / np.diag(A), 10 * n, 1e-12)
    np.testing.assert_allclose(by_diagonal, wanted, rtol=1e-6, atol=1e-8)
    # With the inverse for a preconditioner one step is all it takes.
    inverse = np.linalg.inv(A)
    np.testing.assert_allclose(
        conjugate_gradients(A, b, x, lambda r: inverse @ r, 1, 0.0), wanted, rtol=1e-6, atol=1e-8
    )


def test_conjugate_gradients_stop_where_they_are_told_to():
    rng = np.random.default_rng(0)
    A, b, x = definite(rng, 20), rng.normal(size=20), rng.normal(size=20)
    np.testing.assert_array_equal(conjugate_gradients(A, b, x, np.ones(20), 0, 0.0), x)
    exact = np.linalg.solve(A, b)
    np.testing.assert_array_equal(
        conjugate_gradients(A, A @ exact, exact, np.ones(20), 9, 1e-3), exact
    )
    np.testing.assert_array_equal(conjugate_gradients(A, 0 * b, 0 * x, np.ones(20), 9, 1e-3), 0.0)
    # A loose tolerance is met after few steps, and not exceeded by many digits.
    errors = [
        np.linalg.norm(conjugate_gradients(A, b, x, 1 / np.diag(A), 99, t) - exact)
        for t in (0.1, 1e-4)
    ]
    assert 1e-8 < errors[1] < 0.01 * errors[0]
