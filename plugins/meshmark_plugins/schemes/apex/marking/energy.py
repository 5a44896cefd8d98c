"""What a displacement costs: leaving the surface, stretching triangles, moving far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.kernels import compiled
from meshmark.mesh.geometry import vertex_areas
from meshmark_plugins.schemes.apex.linear_algebra.triangle_energy import (
    diagonal_blocks,
    energy_product,
)
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
            self.blocks * moving[:, None, None],
            self.stretching.F,
            self.stretching.side_costs(stretching),
        )


@dataclass(frozen=True, eq=False)
class WeightedEnergy:
    """An energy as an operator on displacements (3 N,), with its block diagonal.

    Parameters
    ----------
    blocks : (N, 3, 3) float64
        Cost of moving each vertex, by direction.
    F : (F, 3) int
        Triangles.
    side_costs : (F, 3) float64
        Cost of moving the ends of the side opposite to each corner apart.
    """

    blocks: FloatArray
    F: IntArray
    side_costs: FloatArray

    def __matmul__(self, d: FloatArray) -> FloatArray:
        return energy_product(self.blocks, self.F, self.side_costs, d)

    def diagonal_blocks(self) -> FloatArray:
        """Return the block diagonal, (N, 3, 3)."""
        return diagonal_blocks(self.blocks, self.F, self.side_costs)


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
    sliding = SlidingCost(F)
    blocks = np.zeros((len(V), 3, 3))
    for P, G in poses:
        blocks += carried_back(sliding.cost(P), G)
    share = vertex_areas(V, F)
    share = share / share.sum()
    return DisplacementEnergy(
        blocks=blocks / len(poses) * share[:, None, None],
        stretching=stretching_energy(V, F, width),
    )


@compiled
def carried_back(cost: FloatArray, G: FloatArray) -> FloatArray:
    """Cost G^T C G of displacements that gradients G carry to where C is their cost, (N, 3, 3)."""
    return np.swapaxes(G, 1, 2) @ cost @ G
