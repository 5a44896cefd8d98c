"""Solves for the displacement that brings chips to their targets at the least cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_matrix, vstack

from meshmark.arrays import FloatArray
from meshmark.mesh.geometry import lengths
from meshmark_plugins.schemes.apex.linear_algebra.conjugate_gradients import conjugate_gradients
from meshmark_plugins.schemes.apex.marking.energy import DisplacementEnergy, WeightedEnergy

# Rounds of reweighting: which chips still fall short, what moved or stretched far, solve.
REWEIGHTING_ROUNDS = 4
CG_ITERATIONS = 12
CG_TOLERANCE = 1e-3
# A move beyond its reach costs more than its square, by 1 + (length / reach)^PENALTY_EXPONENT, and
# so does a stretch beyond STRAIN_LIMIT: at a strain of 1, triangles fold.
PENALTY_EXPONENT = 4
STRAIN_LIMIT = 0.5
# A chip's price rises with the share q of its target that it lacks, as BASE_PRICE + LACK_PRICE q^2
# up to q = MAX_LACK: a wrong bit costs more than several that could be clearer.
BASE_PRICE, LACK_PRICE, MAX_LACK = 0.5, 3.0, 1.5


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """What one pose asks of the displacement d: J d = change, each chip at its price.

    Parameters
    ----------
    J : (k, 3 N) sparse float64
        Change of each chip, in the sense its word wants, by the displacement.
    change : (k,) float64
        Change each chip needs, from no displacement at all.
    target : (k,) float64
        Value of each chip, in the sense of its word, once it has changed so.
    price : (k,) float64
        Price of a unit of shortfall, squared; 0 for an erasure.
    """

    J: csr_matrix
    change: FloatArray
    target: FloatArray
    price: FloatArray


def solve_displacement(
    constraints: list[LinearConstraints],
    energy: DisplacementEnergy,
    reach: float,
    start: FloatArray,
) -> FloatArray:
    """Minimise the energy plus the chips' squared shortfalls times their prices.

    Parameters
    ----------
    constraints : list of LinearConstraints
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
    moves and strong stretches. All are dealt with by iteratively reweighted least squares: by
    solving again with new weights, half way (in their logarithms) from the old ones, which would
    swing to and fro otherwise. Each solution is by conjugate gradients. The same chip asks for
    much the same in every pose; its mean over the poses, a matrix of as many rows as one pose
    has chips, makes the preconditioner.
    """
    J = csr_matrix(vstack([pose.J for pose in constraints], format="csr"))
    JT = csr_matrix(J.T)
    change = np.concatenate([pose.change for pose in constraints])
    target = np.concatenate([pose.target for pose in constraints])
    price = np.concatenate([pose.price for pose in constraints]) / len(constraints)
    d, active = start, price
    urgency, moving, stretching = np.ones(len(price)), *_penalties(energy, reach, start)
    for turn in range(REWEIGHTING_ROUNDS):
        if turn > 0:
            lacking = np.maximum(change - J @ d, 0.0) / target
            urgency = np.sqrt(
                urgency * (BASE_PRICE + LACK_PRICE * np.minimum(lacking, MAX_LACK) ** 2)
            )
            active = np.where(lacking > 0.0, urgency * price, 0.0)
            far, strong = _penalties(energy, reach, d)
            moving, stretching = np.sqrt(moving * far), np.sqrt(stretching * strong)
        cost = energy.weighted(moving, stretching)
        operator = _Operator(cost, J, JT, active)
        inverse = _Preconditioner(cost, J, active.reshape(len(constraints), -1))
        d = conjugate_gradients(
            operator, JT @ (active * change), d, inverse, CG_ITERATIONS, CG_TOLERANCE
        )
    return d


def _penalties(
    energy: DisplacementEnergy, reach: float, d: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Factors to the squared cost of moving each vertex, and of stretching each triangle."""
    length = lengths(d.reshape(-1, 3))
    strain = energy.stretching.strains(d)
    return 1.0 + (length / reach) ** PENALTY_EXPONENT, 1.0 + (
        strain / STRAIN_LIMIT
    ) ** PENALTY_EXPONENT


@dataclass(frozen=True, eq=False)
class _Operator:
    cost: WeightedEnergy
    J: csr_matrix
    JT: csr_matrix
    active: FloatArray

    def __matmul__(self, d: FloatArray) -> FloatArray:
        return self.cost @ d + self.JT @ (self.active * (self.J @ d))


class _Preconditioner:
    """Inverse of the energy's block diagonal plus the mean chips, by the Woodbury identity."""

    def __init__(self, cost: WeightedEnergy, J: csr_matrix, weights: FloatArray) -> None:
        """Take the weighted mean of each chip over the poses, from weights (poses, k)."""
        self._inverse = cost.inverse_blocks()
        total = weights.sum(axis=0)
        kept = np.flatnonzero(total > 0.0)
        share = (weights[:, kept] / total[kept]).T
        columns = kept[:, None] + weights.shape[1] * np.arange(len(weights))
        starts = len(weights) * np.arange(len(kept) + 1)
        shape = (len(kept), weights.size)
        self._mean = csr_matrix((share.ravel(), columns.ravel(), starts), shape=shape) @ J
        self._spread = csr_matrix(self._inverse @ self._mean.T)
        small = (self._mean @ self._spread).toarray() + np.diag(1.0 / total[kept])
        self._factor = cho_factor(small) if len(kept) else None

    def __call__(self, r: FloatArray) -> FloatArray:
        y: FloatArray = self._inverse @ r
        if self._factor is None:
            return y
        return y - self._spread @ cho_solve(self._factor, self._mean @ y)
