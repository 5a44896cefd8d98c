"""Solves for the displacement that brings chips to their targets at the least cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray
from meshmark.mesh.geometry import lengths
from meshmark_plugins.schemes.apex.linear_algebra.block_woodbury import BlockWoodbury, MeanRows
from meshmark_plugins.schemes.apex.linear_algebra.conjugate_gradients import conjugate_gradients
from meshmark_plugins.schemes.apex.linear_algebra.vertex_rows import VertexRows
from meshmark_plugins.schemes.apex.marking.energy import DisplacementEnergy, WeightedEnergy

# Whole steps to take, and steps at most; those that had to be shortened are on the way only.
WHOLE_STEPS, MAX_STEPS = 3, 12
CG_ITERATIONS = 4
CG_TOLERANCE = 1e-3
# Halvings of a step that leads uphill in the end.
MAX_HALVINGS = 6
# A move beyond its reach costs more than its square, by 1 + (length / reach)^4, and so does a
# stretch beyond STRAIN_LIMIT: at a strain of 1, triangles fold.
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
    moves and strong stretches. Newton's method deals with them all: the curvature at a displacement
    gives a step, which is halved while the cost still rises at its end. Each step is by conjugate
    gradients. The same chip asks for much the same in every pose; its mean over the poses, a
    matrix of as many rows as one pose has chips, makes the preconditioner.
    """
    problem = _Problem(constraints, energy, reach)
    here, whole_steps = problem.at(start), 0
    for _ in range(MAX_STEPS):
        here, whole = _descend(problem, here)
        whole_steps += int(whole)
        if whole_steps == WHOLE_STEPS:
            break
    return here.d


def _descend(problem: _Problem, here: _Point) -> tuple[_Point, bool]:
    """Take a step; tell whether it did not have to be shortened."""
    step = problem.newton_step(here)
    for halvings in range(MAX_HALVINGS + 1):
        there = problem.at(here.d + 0.5**halvings * step)
        if there.gradient @ step <= 0.0:
            break
    return there, halvings == 0


@dataclass(frozen=True, eq=False)
class _Point:
    """A displacement d, the gradient of its cost, and what its curvature follows from.

    Lengths of moves (N,) and strains (F,) are in their limits and to the power of 4, what chips
    lack (k,) is in their targets.
    """

    d: FloatArray
    gradient: FloatArray
    far: FloatArray
    strong: FloatArray
    lacking: FloatArray


class _Problem:
    """The cost of displacements: energy, penalties, and shortfalls in all poses."""

    def __init__(
        self, constraints: list[LinearConstraints], energy: DisplacementEnergy, reach: float
    ) -> None:
        self._energy, self._reach, self._n_poses = energy, reach, len(constraints)
        self._J = VertexRows.stacked([pose.J for pose in constraints])
        self._means = MeanRows(self._J, len(constraints[0].price))
        self._change = np.concatenate([pose.change for pose in constraints])
        self._target = np.concatenate([pose.target for pose in constraints])
        self._price = np.concatenate([pose.price for pose in constraints]) / len(constraints)

    def at(self, d: FloatArray) -> _Point:
        """Look at a displacement."""
        # A square of squares: other powers take numpy far longer.
        far = ((lengths(d.reshape(-1, 3)) / self._reach) ** 2) ** 2
        strong = ((self._energy.stretching.strains(d) / STRAIN_LIMIT) ** 2) ** 2
        short = np.maximum(self._change - self._J @ d, 0.0)
        lacking = short / self._target
        dearer = BASE_PRICE + LACK_PRICE * np.minimum(lacking, MAX_LACK) ** 2
        pull = self._J.sums(self._price * dearer * short)
        gradient = self._energy.weighted(1.0 + far, 1.0 + strong) @ d - pull
        return _Point(d, gradient, far, strong, lacking)

    def newton_step(self, point: _Point) -> FloatArray:
        """Find a step to where the gradient would vanish, did it change as it does at a point."""
        # The derivative of x + x^5 is 1 + 5 x^4, that of q + q^3 is 1 + 3 q^2.
        cost = self._energy.weighted(1.0 + 5.0 * point.far, 1.0 + 5.0 * point.strong)
        growing = np.where(point.lacking < MAX_LACK, 3.0, 1.0)
        dearer = BASE_PRICE + LACK_PRICE * growing * np.minimum(point.lacking, MAX_LACK) ** 2
        active = np.where(point.lacking > 0.0, dearer * self._price, 0.0)
        inverse = BlockWoodbury(
            cost.diagonal_blocks(), self._means, active.reshape(self._n_poses, -1)
        )
        return conjugate_gradients(
            _Curvature(cost, self._J, active),
            -point.gradient,
            np.zeros_like(point.d),
            inverse,
            CG_ITERATIONS,
            CG_TOLERANCE,
        )


@dataclass(frozen=True, eq=False)
class _Curvature:
    cost: WeightedEnergy
    J: VertexRows
    active: FloatArray

    def __matmul__(self, d: FloatArray) -> FloatArray:
        return self.cost @ d + self.J.squared(self.active, d)
