"""What a cut costs along each edge: less in concave creases, where parts meet."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray
from meshmark_plugins.segmenters.sdf.dual import DualGraph

CONCAVITY = 2.0
"""A crease as sharp as its radius `reach` costs exp(-CONCAVITY) of the same length elsewhere."""

SHARPEST = 3.0


def cut_costs(normal: FloatArray, dual: DualGraph, reach: float) -> FloatArray:
    """Price the edges between faces: their length, lowered by concave curvature across them.

    Parameters
    ----------
    normal : (F, 3) float64
        Smoothed normals, of any length.
    dual : DualGraph
        The faces.
    reach : float
        Length over which the normals were smoothed, in the dual's unit.

    Returns
    -------
    (A,) float64
        Cost of cutting between each pair of faces.

    Notes
    -----
    Shapira et al. weight the length by a function of the dihedral angle alone. The angle of an
    edge shrinks as faces do, and noise swamps it on slivers; curvature of smoothed normals
    does neither, so a cut falls into the same crease on a noisy or simplified mesh.
    """
    norm = np.linalg.norm(normal, axis=1, keepdims=True)
    unit = normal / np.where(norm > 0.0, norm, 1.0)
    i, j = dual.pairs.T
    span = dual.span
    square = np.einsum("ij,ij->i", span, span)
    closest = 1e-4 * np.median(dual.area)
    turn = np.einsum("ij,ij->i", unit[j] - unit[i], span)
    # Normals that turn towards each other along the way make a valley.
    curvature = -turn / np.maximum(square, max(closest, np.finfo(float).tiny))
    return dual.length * np.exp(-CONCAVITY * np.clip(reach * curvature, 0.0, SHARPEST))
