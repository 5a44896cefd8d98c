"""From a rough placement to an exact one: similarity and pose together, point to plane."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshmark.alignment.matching import Match, Matcher
from meshmark.alignment.robust import scale_of, tukey
from meshmark.arrays import FloatArray
from meshmark.mesh.geometry import lengths

# Steps, as shares of the diagonal and of a frame, below which it has converged.
STILL, STILL_POSE = 1e-7, 1e-4
# So are steps that are this share of the distances: what is left of them is chance.
CHANCE = 2e-3
# The farthest turn, growth and shift of one step.
LEAP = 0.3
# A pose so near to a frame is that frame.
SNAP = 0.05
# Residuals below this share of the diagonal are rounding: all weigh alike.
EXACT = 1e-7
# Normals that differ by more than its arc cosine are of another sheet of the surface.
AGREE = 0.3


@dataclass(frozen=True, eq=False)
class Placement:
    """A similarity and a pose.

    Parameters
    ----------
    A : (3, 4) float64
        The copy's point p lies at A p of the original's space.
    pose : float
        Real-valued index of a frame of the original.
    """

    A: FloatArray
    pose: float

    @property
    def mirrors(self) -> bool:
        """Whether it maps shapes to their mirror images."""
        return bool(np.linalg.det(self.A[:, :3]) < 0)

    def __call__(self, P: FloatArray) -> FloatArray:
        """Map points (n, 3) of the copy."""
        mapped: FloatArray = P @ self.A[:, :3].T + self.A[:, 3]
        return mapped

    def turned(self, normals: FloatArray) -> FloatArray:
        """Map unit normals (n, 3) of the copy's faces; those of mirror images point inwards."""
        R = self.A[:, :3]
        scale = np.cbrt(abs(np.linalg.det(R))) or 1.0
        mapped: FloatArray = normals @ R.T / scale
        return mapped


@dataclass(frozen=True, eq=False)
class Rest:
    """The rest of a placement: how far vertices are from the surface, in diagonals.

    Parameters
    ----------
    distances : (n,) float64
    agree : (n,) bool
        Whether the normals agree.
    slip : float
        See `meshmark.alignment.matching.Match.slip`.
    """

    distances: FloatArray
    agree: NDArray[np.bool_]
    slip: float


class Refinement:
    """Least squares on one frame of a copy against the poses of the original.

    Parameters
    ----------
    P, normals : (n, 3) float64
        Vertices of the copy, and the unit normals there.
    matcher_at : callable
        Builds the matcher of a pose.
    poses : int
        Number of frames of the original.
    centre : (3,) float64
    diagonal : float
        Of the original's bounding box.
    reach : float
        Vertices farther from the surface than this share of the diagonal do not count.
    """

    def __init__(
        self,
        P: FloatArray,
        normals: FloatArray,
        matcher_at: Callable[[float], Matcher],
        poses: int,
        centre: FloatArray,
        diagonal: float,
        reach: float = np.inf,
    ) -> None:
        self._P, self._normals = P, normals
        self._matcher_at, self._last = matcher_at, float(poses - 1)
        self._centre, self._diagonal, self._reach = centre, diagonal, reach

    def refine(self, start: Placement, rounds: int, free_pose: bool = True) -> Placement:
        """Converge from a start; a pose next to a frame snaps to it.

        Parameters
        ----------
        rounds : int
            The most steps before the pose snaps, and after.
        free_pose : bool
            Whether the pose may change.
        """
        if not free_pose or self._last == 0:
            return self._converge(start, rounds, False)
        # Most copies show whole frames: one is tried first, without posing anything between.
        if start.pose == round(start.pose):
            whole = self._converge(start, rounds, False)
            if abs(self._converge(whole, 1, True).pose - whole.pose) < SNAP:
                return whole
        found = self._converge(start, rounds, True)
        if 0 < abs(found.pose - round(found.pose)) < SNAP:
            found = self._converge(Placement(found.A, float(round(found.pose))), rounds, False)
        return found

    def rest(self, placement: Placement) -> Rest:
        """Measure what a placement leaves."""
        X = placement(self._P)
        match = self._matcher_at(placement.pose).match(X)
        gap = (X - match.points) / self._diagonal
        return Rest(lengths(gap), self._agree(placement, match), match.slip(gap))

    def _converge(self, placement: Placement, rounds: int, free_pose: bool) -> Placement:
        matcher = self._matcher_at(placement.pose)
        for _ in range(rounds):
            X = placement(self._P)
            match = matcher.match(X)
            step, scale = self._step(X, match, self._agree(placement, match), free_pose)
            before = placement.pose
            placement = self._moved(placement, step)
            if (
                np.abs(step[:7]).max() < max(STILL, CHANCE * scale)
                and abs(placement.pose - before) < STILL_POSE
            ):
                break
            if placement.pose != before:
                matcher = self._matcher_at(placement.pose)
        return placement

    def _agree(self, placement: Placement, match: Match) -> NDArray[np.bool_]:
        cosine = (placement.turned(self._normals) * match.normals).sum(axis=1)
        # Faces may have been turned over, all together.
        agree: NDArray[np.bool_] = np.sign(cosine.sum()) * cosine > AGREE
        return agree

    def _step(
        self, X: FloatArray, match: Match, agree: NDArray[np.bool_], free_pose: bool
    ) -> tuple[FloatArray, float]:
        """Solve for turn (3), log of scale, translation (3), in diagonals, and pose.

        Returns
        -------
        step : (8,) float64
        scale : float
            Of the distances, in diagonals.
        """
        gap = (X - match.points) / self._diagonal
        y = (X - self._centre) / self._diagonal
        n = match.normals
        across = (gap * n).sum(axis=1)
        distance = lengths(gap)
        within = distance < self._reach
        scale = scale_of(distance[within]) if within.any() else self._reach
        w = tukey(distance, max(scale, EXACT)) * (agree & within)
        J = np.column_stack(
            [np.cross(y, n), (y * n).sum(axis=1), n, -(match.motion * n).sum(axis=1)]
        )
        J[:, 7] /= self._diagonal
        H, g = (J * w[:, None]).T @ J, J.T @ (w * across)
        if match.paired:
            slip = match.slip(gap)
            everywhere = _along(y, gap, match, w, self._diagonal)
            H, g = (1 - slip) * H + slip * everywhere[0], (1 - slip) * g + slip * everywhere[1]
        k = 8 if free_pose and H[7, 7] > 1e-20 * max(H[4:7, 4:7].trace(), 1e-300) else 7
        size = np.sqrt(np.maximum(np.diag(H)[:k], np.finfo(float).tiny))
        step = np.zeros(8)
        step[:k] = -np.linalg.lstsq(H[:k, :k] / np.outer(size, size), g[:k] / size, 1e-9)[0] / size
        step[:7] /= max(1.0, float(np.abs(step[:7]).max()) / LEAP)
        return step, scale

    def _moved(self, placement: Placement, step: FloatArray) -> Placement:
        from scipy.spatial.transform import Rotation

        R = np.exp(step[3]) * Rotation.from_rotvec(step[:3]).as_matrix()
        A = R @ placement.A
        A[:, 3] += self._centre - R @ self._centre + self._diagonal * step[4:7]
        pose = float(np.clip(placement.pose + np.clip(step[7], -1.0, 1.0), 0.0, self._last))
        return Placement(A, pose)


def _along(
    y: FloatArray, gap: FloatArray, match: Match, w: FloatArray, diagonal: float
) -> tuple[FloatArray, FloatArray]:
    """Sum the normal equations of all three coordinates of the distances."""
    n = len(y)
    J = np.zeros((n, 3, 8))
    J[:, 0, 1], J[:, 0, 2] = y[:, 2], -y[:, 1]
    J[:, 1, 0], J[:, 1, 2] = -y[:, 2], y[:, 0]
    J[:, 2, 0], J[:, 2, 1] = y[:, 1], -y[:, 0]
    J[:, :, 3] = y
    J[:, :, 4:7] = np.eye(3)
    J[:, :, 7] = -match.motion / diagonal
    flat, weights = J.reshape(-1, 8), np.repeat(w, 3)
    return (flat * weights[:, None]).T @ flat, flat.T @ (weights * gap.ravel())
