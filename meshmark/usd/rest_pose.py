"""Moves of the rest pose that make a rig show marked points as nearly as it can."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray
from meshmark.mesh.precision import stored
from meshmark.usd.geometry import REST
from meshmark.usd.points import MeshPoints

# Directions that all poses flatten this much, relative to the others, say nothing.
FLAT = 1e-6


@dataclass(eq=False)
class RestMoves:
    """Collects moves of posed points, and answers with that of the rest pose.

    A pose is an affine map of each vertex of the rest pose: a move d of the rest pose moves the
    posed vertex by d A, with a matrix A (3, 3) for each vertex and time. The answer is the least
    squares solution over all times. Holds sums, not poses.

    Parameters
    ----------
    mesh : MeshPoints
        Posed by a rig, from a rest pose without time samples.
    """

    mesh: MeshPoints
    points: NDArray[np.floating] = field(init=False)
    _squares: FloatArray = field(init=False)
    _products: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.points = self.mesh.local(REST)
        self._squares = np.zeros((len(self.points), 3, 3))
        self._products = np.zeros((len(self.points), 3))

    def add(self, time: float, moves: NDArray[np.floating]) -> None:
        """Take note of the moves (N, 3) of the points at a time, in the prim's own space."""
        A = self._matrices(time)
        self._squares += A @ A.transpose(0, 2, 1)
        self._products += np.einsum("nj,nij->ni", moves.astype(np.float64), A)

    def _matrices(self, time: float) -> FloatArray:
        """Return what the rig does to a move of each vertex of the rest pose, (N, 3, 3)."""
        rig, rest = self.mesh.rig, self.points.astype(np.float64)
        assert rig is not None
        # Large steps: usd-core rounds to single precision.
        step = float(np.ptp(rest, axis=0).max()) or 1.0
        posed = rig.pose(rest, time)
        moved = [rig.pose(rest + step * axis, time) - posed for axis in np.eye(3)]
        return np.stack(moved, axis=1) / step

    def marked(self) -> NDArray[np.floating]:
        """Return the moved rest pose (N, 3), in the type of its points.

        Raises
        ------
        OutputError
            If a point is beyond what that type holds.
        """
        inverse = np.linalg.pinv(self._squares, rcond=FLAT, hermitian=True)
        moves = np.einsum("nij,nj->ni", inverse, self._products)
        return stored(self.points + moves, self.points.dtype)
