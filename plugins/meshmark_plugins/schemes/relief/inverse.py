"""Inverses on a surface, of fine meshes by a coarse one: what is smooth needs few vertices."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix
from scipy.sparse.linalg import SuperLU, splu

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.proxy import build_proxy
from meshmark.mesh.topology import face_components

# Meshes of more vertices are smoothed on about so many: four across a disc of the smallest radius.
MOST_VERTICES, COARSE_VERTICES = 100_000, 50_000
# A component that would keep more than this share of its vertices keeps them all.
MOST_KEPT = 0.5


class Inverse:
    """Applies the inverse of a sparse symmetric matrix; built once, asked many times.

    Parameters
    ----------
    A : (N, N) sparse
    space : (N, n) sparse, optional
        The inverse is taken among the fields that these columns span, as finite elements do.
    """

    def __init__(self, A: Any, space: csr_matrix | None = None) -> None:
        self._space = space
        self._factor = factored(A if space is None else space.T @ A @ space)

    def __call__(self, b: Any) -> Any:
        """Apply it to b (N,) or (N, k)."""
        if self._space is None:
            return self._factor.solve(b)
        return self._space @ self._factor.solve(self._space.T @ b)


def factored(A: Any) -> SuperLU:
    """Factor a sparse symmetric matrix (N, N), such as that of a triangle mesh."""
    # Column by column: the columns of a triangle mesh have too little in common for panels.
    return splu(
        csc_matrix(A),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        relax=1,
        panel_size=1,
        options={"SymmetricMode": True},
    )


def coarse_space(V: FloatArray, F: IntArray) -> csr_matrix | None:
    """Find the fields that are linear in the triangles of a coarser mesh, for a fine one.

    Parameters
    ----------
    V : (N, 3) float64
    F : (F, 3) int

    Returns
    -------
    (N, n) sparse float64 or None
        Values at the coarse vertices become values at the fine ones; rows sum to 1. None where
        the mesh is coarse enough. Components that no coarser mesh stands for keep their vertices.
    """
    if len(V) <= MOST_VERTICES:
        return None
    label, areas = face_components(F), face_areas(V, F)
    spacing = areas.sum() / COARSE_VERTICES
    rows, columns, shares, n = [], [], [], 0
    left = np.ones(len(V), dtype=bool)
    for number in np.flatnonzero(np.bincount(label) > COARSE_VERTICES / MOST_KEPT):
        own = label == number
        vertices, local = np.unique(F[own], return_inverse=True)
        wanted = int(areas[own].sum() / spacing)
        if not 0 < wanted <= MOST_KEPT * len(vertices):
            continue
        proxy = build_proxy(V[vertices], local.reshape(-1, 3), wanted)
        if proxy is not None:
            part = proxy.prolongation.tocoo()
            rows.append(vertices[part.row])
            columns.append(n + part.col)
            shares.append(part.data)
            n += len(proxy.samples)
            left[vertices] = False
    alone = np.flatnonzero(left)
    rows.append(alone)
    columns.append(n + np.arange(len(alone)))
    shares.append(np.ones(len(alone)))
    places = (np.concatenate(rows), np.concatenate(columns))
    P = csr_matrix((np.concatenate(shares), places), (len(V), n + len(alone)))
    # A vertex that two components share is a mean of both.
    P.data /= np.repeat(np.asarray(P.sum(axis=1)).ravel(), np.diff(P.indptr))
    return P
