"""Whitening: weights that even out how densely vertices lie on a surface."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from scipy.sparse import csr_matrix, diags_array

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.geometry import vertex_areas
from meshmark.mesh.laplacian import (
    cotangent_weights,
    stiffness_matrix,
)
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField
from meshmark_plugins.schemes.apex.linear_algebra.conjugate_gradients import conjugate_gradients

CG_ITERATIONS = 60
CG_TOLERANCE = 1e-7
# Share of the mean vertex area that every vertex is given at least.
MIN_VERTEX_AREA_SHARE = 1e-3

# A function such as `spread_masses`.
SpreadMasses: TypeAlias = Callable[
    [FloatArray, IntArray, FloatArray, float, FloatArray, int, float], FloatArray
]


def whitening_weights(field: GeodesicField, width: float) -> FloatArray:
    """Whitening weights of a component's vertices, (n,), on the scale of half a bin."""
    V, F, _ = field.surface
    length = width / 2.0
    if field.on_proxy is None:
        return inverse_density(V, F, field.length_scale, length)
    P = field.on_proxy.proxy.prolongation
    return inverse_density_on_proxy(V, F, field.length_scale, length, P)


def inverse_density(V: FloatArray, F: IntArray, root_area: float, length: float) -> FloatArray:
    """Weight of each vertex that makes the weighted density even on the scale of `length`.

    Parameters
    ----------
    V : (N, 3) float64
        Vertex positions.
    F : (F, 3) int
        Triangles.
    root_area : float
        Square root of the surface's area.
    length : float
        Diffusion length, in root areas.

    Returns
    -------
    (N,) float64
        1 / y, where (M + length^2 L) y = 1 with lumped areas M and the cotangent Laplacian L:
        unit mass at every vertex, diffused over the surface. Sums to about 1.
    """
    return _inverse(_density(V, F, root_area, length, np.ones(len(V))))


def inverse_density_on_proxy(
    V: FloatArray,
    F: IntArray,
    root_area: float,
    length: float,
    prolongation: csr_matrix,
    spread: SpreadMasses | None = None,
) -> FloatArray:
    """Weights of the vertices of a mesh (N,), as of `inverse_density`, by a proxy V, F of it.

    Their masses are spread on the proxy; `prolongation` (N, n) tells where they lie on it.
    `spread` may be quicker than `spread_masses`.
    """
    masses = prolongation.T @ np.ones(prolongation.shape[0])
    return _inverse(prolongation @ _density(V, F, root_area, length, masses, spread))


def _density(
    V: FloatArray,
    F: IntArray,
    root_area: float,
    length: float,
    masses: FloatArray,
    spread: SpreadMasses | None = None,
) -> FloatArray:
    """Density of masses at vertices, spread over a surface: (M + length^2 L)^-1 m, (N,)."""
    areas = vertex_areas(V, F) / root_area**2
    areas = np.maximum(areas, MIN_VERTEX_AREA_SHARE * areas.mean())
    weights, solve = cotangent_weights(V, F), spread or spread_masses
    return solve(areas, F, weights, length, masses, CG_ITERATIONS, CG_TOLERANCE)


def spread_masses(
    areas: FloatArray,
    F: IntArray,
    weights: FloatArray,
    length: float,
    masses: FloatArray,
    iterations: int,
    tolerance: float,
) -> FloatArray:
    """Spread masses (N,) over a surface, to a density, (N,); see `inverse_density`.

    Parameters
    ----------
    areas : (N,) float64
        Lumped areas.
    F : (F, 3) int
        Triangles.
    weights : (F, 3) float64
        Cotangent weights of the Laplacian.
    iterations, tolerance
        Of conjugate gradients.
    """
    A = csr_matrix(diags_array(areas) + length**2 * stiffness_matrix(F, weights, len(areas)))
    start = np.full(len(areas), masses.sum())
    return conjugate_gradients(A, masses, start, 1.0 / A.diagonal(), iterations, tolerance)


@compiled
def spread_masses_by_rows(
    areas: FloatArray,
    F: IntArray,
    weights: FloatArray,
    length: float,
    masses: FloatArray,
    iterations: int,
    tolerance: float,
) -> FloatArray:
    """Do what `spread_masses` does, quicker; copies are looked at without loops to load."""
    return spread_masses(areas, F, weights, length, masses, iterations, tolerance)


def _inverse(density: FloatArray) -> FloatArray:
    """1 / density, bounded: few vertices are far from all others."""
    return 1.0 / np.maximum(density, 1e-9 * len(density))
