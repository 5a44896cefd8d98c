"""Energies of displacements that are sums over vertices and over the sides of triangles."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.laplacian import stiffness_matrix


@compiled
def energy_product(
    blocks: FloatArray, F: IntArray, side_costs: FloatArray, d: FloatArray
) -> FloatArray:
    """Multiply a displacement (3 N,) by the matrix of an energy, (3 N,).

    Parameters
    ----------
    blocks : (N, 3, 3) float64
        Cost of moving each vertex, by direction.
    F : (F, 3) int
        Triangles.
    side_costs : (F, 3) float64
        Cost of moving the ends of the side opposite to each corner apart.
    d : (3 N,) float64
        The displacement.
    """
    moves = d.reshape(-1, 3)
    apart = stiffness_matrix(F, side_costs, len(blocks)) @ moves
    return np.ravel(np.einsum("nij,nj->ni", blocks, moves) + apart)


@compiled
def diagonal_blocks(blocks: FloatArray, F: IntArray, side_costs: FloatArray) -> FloatArray:
    """Compute the block diagonal of the matrix of an energy, (N, 3, 3)."""
    stretch = stiffness_matrix(F, side_costs, len(blocks)).diagonal()
    return np.asarray(blocks + stretch[:, None, None] * np.eye(3))


@compiled
def strains(
    F: IntArray, corner_products: FloatArray, double_areas: FloatArray, d: FloatArray
) -> FloatArray:
    """Frobenius norm of the gradient of a displacement (3 N,) in each triangle, (F,).

    Parameters
    ----------
    F : (F, 3) int
        Triangles.
    corner_products : (F, 3) float64
        Inner product of the two sides at each corner.
    double_areas : (F,) float64
        Twice the area of each triangle.
    d : (3 N,) float64
        The displacement.
    """
    moves = d.reshape(-1, 3)[F]
    square = np.zeros(len(F))
    for k in range(3):
        change = moves[:, (k + 2) % 3] - moves[:, (k + 1) % 3]
        square += corner_products[:, k] * np.einsum("fx,fx->f", change, change)
    return np.sqrt(np.maximum(square, 0.0)) / double_areas
