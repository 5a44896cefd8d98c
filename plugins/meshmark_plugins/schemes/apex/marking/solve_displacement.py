"""The displacement that brings many chips to their targets at the least cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_matrix, diags_array, vstack

from meshmark.arrays import FloatArray
from meshmark.mesh.geometry import lengths
from meshmark_plugins.schemes.apex.linear_algebra.conjugate_gradients import solve
from meshmark_plugins.schemes.apex.marking.energy import Energy, WeightedEnergy

# Rounds of: which chips still fall short, what moved or stretched far, solve.
ROUNDS = 4
ITERATIONS = 12
TOLERANCE = 1e-3
# How steeply the cost of a move rises beyond its reach, and that of a stretch beyond STRAIN:
# at a strain of 1, triangles fold.
STEEPNESS = 4
STRAIN = 0.5
# A chip's price rises with the share of its target that it lacks: a wrong bit costs more than
# several that could be clearer. Prices at nothing lacking, by the square of what lacks, and the
# share from which on they rise no more.
CALM, URGENT, WORST = 0.5, 3.0, 1.5


@dataclass(frozen=True, eq=False)
class Demand:
    """What one pose asks of the displacement.

    Parameters
    ----------
    J : (k, 3 N) sparse float64
        Change of each chip, in the sense its word wants, by the displacement.
    change : (k,) float64
        Change each chip needs, from no displacement at all.
    target : (k,) float64
        Where that leads it.
    weight : (k,) float64
        Price of a unit of shortfall, squared; 0 for an erasure.
    """

    J: csr_matrix
    change: FloatArray
    target: FloatArray
    weight: FloatArray


def displacement(
    demands: list[Demand], energy: Energy, reach: float, start: FloatArray
) -> FloatArray:
    """Minimise energy plus the weighted squares of what the chips fall short of.

    Parameters
    ----------
    demands : list of Demand
        One for each pose; all poses count alike.
    energy : Energy
        Cost of displacements.
    reach : float
        Length beyond which a move becomes much dearer.
    start : (3 N,) float64
        First guess.

    Returns
    -------
    (3 N,) float64

    Notes
    -----
    A chip beyond its target costs nothing, one far from it more than its square, and so do long
    moves and strong stretches: all are dealt with by solving again with new weights, half way
    (in their logarithms) from the old ones, which would swing to and fro otherwise. The same
    chip asks for much the same in every pose; its mean over the poses, a matrix of as many rows
    as one pose has chips, makes the preconditioner.
    """
    J = csr_matrix(vstack([demand.J for demand in demands], format="csr"))
    JT = csr_matrix(J.T)
    change = np.concatenate([demand.change for demand in demands])
    target = np.concatenate([demand.target for demand in demands])
    price = np.concatenate([demand.weight for demand in demands]) / len(demands)
    d, active = start, price
    urgency, moving, stretching = np.ones(len(price)), *_dearer(energy, reach, start)
    for turn in range(ROUNDS):
        if turn > 0:
            lacking = np.maximum(change - J @ d, 0.0) / target
            urgency = np.sqrt(urgency * (CALM + URGENT * np.minimum(lacking, WORST) ** 2))
            active = np.where(lacking > 0.0, urgency * price, 0.0)
            far, strong = _dearer(energy, reach, d)
            moving, stretching = np.sqrt(moving * far), np.sqrt(stretching * strong)
        cost = energy.weighted(moving, stretching)
        operator = _Operator(cost, J, JT, active)
        inverse = _Preconditioner(cost, demands, active)
        d = solve(operator, JT @ (active * change), d, inverse, ITERATIONS, TOLERANCE)
    return d


def _dearer(energy: Energy, reach: float, d: FloatArray) -> tuple[FloatArray, FloatArray]:
    """How much dearer moving each vertex and stretching each triangle is than its square."""
    length = lengths(d.reshape(-1, 3))
    strain = energy.stretching.strains(d)
    return 1.0 + (length / reach) ** STEEPNESS, 1.0 + (strain / STRAIN) ** STEEPNESS


@dataclass(frozen=True, eq=False)
class _Operator:
    cost: WeightedEnergy
    J: csr_matrix
    JT: csr_matrix
    active: FloatArray

    def __matmul__(self, d: FloatArray) -> FloatArray:
        return self.cost @ d + self.JT @ (self.active * (self.J @ d))


class _Preconditioner:
    """Inverse of the block diagonal plus the mean chips, by Woodbury's identity."""

    def __init__(self, cost: WeightedEnergy, demands: list[Demand], active: FloatArray) -> None:
        self._inverse = cost.inverse_blocks()
        k = len(demands[0].change)
        weights = active.reshape(len(demands), k)
        total = weights.sum(axis=0)
        kept = np.flatnonzero(total > 0.0)
        self._mean = csr_matrix((len(kept), demands[0].J.shape[1]))
        for demand, weight in zip(demands, weights, strict=True):
            share = weight[kept] / total[kept]
            self._mean = self._mean + diags_array(share) @ demand.J[kept]
        self._mean = csr_matrix(self._mean)
        self._spread = csr_matrix(self._inverse @ self._mean.T)
        small = (self._mean @ self._spread).toarray() + np.diag(1.0 / total[kept])
        self._factor = cho_factor(small) if len(kept) else None

    def __call__(self, r: FloatArray) -> FloatArray:
        y: FloatArray = self._inverse @ r
        if self._factor is None:
            return y
        return y - self._spread @ cho_solve(self._factor, self._mean @ y)
