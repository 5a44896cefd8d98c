"""Sparse factors of matrices that join the neighbours of a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, eye_array
from scipy.sparse.linalg import SuperLU, splu

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.topology import vertex_adjacency


def elimination_order(F: IntArray, n_points: int) -> IntArray:
    """Find an order of the vertices of a mesh in which factors stay sparse, (N,) int.

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    n_points : int
        N.
    """
    A = vertex_adjacency(F, n_points)
    # Only where there are entries matters; these make it positive definite.
    most = float(np.diff(A.indptr).max(initial=0)) + 1.0
    return np.argsort(_factor(A + most * eye_array(n_points), "MMD_AT_PLUS_A").perm_c)


class SymmetricFactor:
    """The factor of a sparse symmetric positive definite matrix.

    Parameters
    ----------
    A : (n, n) sparse float64
        The matrix.
    order : (n,) int, optional
        An order of its rows in which factors stay sparse, see `elimination_order`; to find one
        takes longer than to factor.

    Raises
    ------
    RuntimeError
        If the matrix is singular.
    """

    def __init__(self, A: Any, order: IntArray | None = None) -> None:
        self._order = order
        if order is None:
            self._factor = _factor(A, "MMD_AT_PLUS_A")
            return
        self._rank = np.empty_like(order)
        self._rank[order] = np.arange(len(order))
        self._factor = _factor(csc_matrix(A)[order][:, order], "NATURAL")

    def solve(self, b: FloatArray) -> FloatArray:
        """Solve A x = b, (n,) or (n, k) float64."""
        if self._order is None:
            found: FloatArray = self._factor.solve(b)
        else:
            found = self._factor.solve(b[self._order])[self._rank]
        return found


def _factor(A: Any, ordering: str) -> SuperLU:
    return splu(
        csc_matrix(A),
        permc_spec=ordering,
        diag_pivot_thresh=0.0,
        # Columns have few entries in common: wider panels only make work.
        panel_size=1,
        options={"SymmetricMode": True},
    )
