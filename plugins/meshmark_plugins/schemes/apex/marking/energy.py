"""What a displacement costs: leaving the surface, stretching triangles, moving far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import vertex_areas
from meshmark_plugins.schemes.apex.marking.sliding import SlidingCost
from meshmark_plugins.schemes.apex.marking.stretching import StretchingEnergy, stretching_energy

# About an anchor vertices hardly move, or it would be found elsewhere; in root areas.
GUARD_RADIUS = 0.05
# What a guarded vertex moves at most, as a share of what it would.
MIN_MOBILITY = 1e-3


@dataclass(frozen=True, eq=False)
class DisplacementEnergy:
    """A quadratic cost of displacements, which are given in root areas of the mesh.

    Parameters
    ----------
    blocks : (N, 3, 3) float64
        Cost of moving each vertex, by direction.
    stretching : Stretching
        Cost of moving neighbours apart, the same for each coordinate.
    """

    blocks: FloatArray
    stretching: StretchingEnergy

    def weighted(self, moving: FloatArray, stretching: FloatArray) -> WeightedEnergy:
        """Make moving vertex i `moving[i]`, and stretching triangle f `stretching[f]` as dear."""
        return WeightedEnergy(
            self.blocks * moving[:, None, None], self.stretching.matrix(stretching)
        )


@dataclass(frozen=True, eq=False)
class WeightedEnergy:
    """An energy as an operator on displacements (3 N,), with its inverse block diagonal."""

    blocks: FloatArray
    stretch: csr_matrix

    def __matmul__(self, d: FloatArray) -> FloatArray:
        moves = d.reshape(-1, 3)
        own = np.einsum("nij,nj->ni", self.blocks, moves)
        return (own + self.stretch @ moves).ravel()

    def inverse_blocks(self) -> bsr_matrix:
        """Invert the block diagonal, (3 N, 3 N) sparse."""
        n = len(self.blocks)
        diagonal = self.stretch.diagonal()[:, None, None] * np.eye(3)
        inverse = np.linalg.inv(self.blocks + diagonal)
        return bsr_matrix((inverse, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n))


def guard_weights(H: FloatArray) -> FloatArray:
    """Factors to the cost of moves near anchors, (n,), from distances (m, n) in root areas."""
    mobility = np.prod(1.0 - np.exp(-((H / GUARD_RADIUS) ** 2)), axis=0)
    return np.maximum(mobility, MIN_MOBILITY) ** -2.0


def energy_over_poses(
    poses: list[tuple[FloatArray, FloatArray]], V: FloatArray, F: IntArray, width: float
) -> DisplacementEnergy:
    """Cost of a displacement of V (N, 3) that is carried through several poses.

    Parameters
    ----------
    poses : list of ((N, 3), (N, 3, 3)) float64
        Positions in each pose, and the gradients that carry displacements there.
    """
    sliding = SlidingCost(F, len(V))
    carried = [
        np.einsum("nji,njk,nkl->nil", G, sliding.cost(P), G, optimize=True) for P, G in poses
    ]
    share = vertex_areas(V, F)
    share = share / share.sum()
    return DisplacementEnergy(
        blocks=np.mean(carried, axis=0) * share[:, None, None],
        stretching=stretching_energy(V, F, width),
    )
