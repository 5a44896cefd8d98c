"""Diffusion of values over the faces of a mesh, by a length and not by a number of rings."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csc_matrix, csr_matrix, diags_array
from scipy.sparse.linalg import splu

from meshmark.arrays import FloatArray
from meshmark_plugins.segmenters.sdf.dual import DualGraph


def diffuse(X: FloatArray, dual: DualGraph, time: float) -> FloatArray:
    """Smooth values over the surface: one implicit step of the heat equation.

    Parameters
    ----------
    X : (F, k) float64
        k values for each face.
    dual : DualGraph
        The faces.
    time : float
        Diffusion time in units of the mesh's area; values blur over a length of sqrt(2 time).

    Returns
    -------
    (F, k) float64
        Smoothed values.

    Notes
    -----
    Solves (A + time L) X' = A X with face areas A and the finite-volume Laplacian L, whose
    conductances are edge length over distance of centroids. Unlike rounds of averaging over
    neighbours, it does the same on a coarse mesh as on a fine one, so that parts survive
    simplification.
    """
    floor = np.sqrt(np.median(dual.area))
    # Bounds on slivers and coincident centroids keep the system well conditioned.
    distance = np.maximum(np.linalg.norm(dual.span, axis=1), 0.2 * floor)
    area = np.maximum(dual.area, 0.01 * floor**2)
    conductance = time * dual.length / np.maximum(distance, np.finfo(float).tiny)
    i, j = dual.pairs.T
    shape = (len(area), len(area))
    W = csr_matrix((np.tile(conductance, 2), (np.r_[i, j], np.r_[j, i])), shape=shape)
    M = csc_matrix(diags_array(area + W.sum(axis=1).A1) - W)
    # The system is symmetric and diagonally dominant: no pivoting, fill-in as of a plane graph.
    factors = splu(
        M, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    smooth = factors.solve(area[:, None] * X)
    if not np.isfinite(smooth).all():
        # One face may be so much larger than all others that their sums are lost in its own.
        raise np.linalg.LinAlgError("the solution is not finite")
    return smooth
