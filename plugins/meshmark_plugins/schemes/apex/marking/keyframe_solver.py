"""Displacements of keyframes, each solved for from where its neighbour's led."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.workers.ordered_map import Workers, ordered_map
from meshmark.workers.scratch import DOUBLE, ScratchFile
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField
from meshmark_plugins.schemes.apex.marking.energy import (
    DisplacementEnergy,
    energy_over_poses,
    guard_weights,
)
from meshmark_plugins.schemes.apex.marking.fold_smoother import FoldSmoother
from meshmark_plugins.schemes.apex.marking.pose_constraints import (
    PoseConstraints,
    PoseTask,
)
from meshmark_plugins.schemes.apex.marking.solve_displacement import (
    LinearConstraints,
    solve_displacement,
)

# Constraints of a pose, and its distances.
Measured: TypeAlias = tuple[LinearConstraints, Any]
# Rounds of measuring and solving at the keyframe that all others start from, and at those.
FIRST_KEYFRAME_ROUNDS, LATER_KEYFRAME_ROUNDS = 4, 2
# Share of the way from the displacement it measured to the one it solved for that a round goes.
# Chips follow moves in proportion only nearby: whole steps overshoot, and the rounds swing to and
# fro.
RELAXATION = 0.5
# Length beyond which moves become dear, in bins.
MOVE_REACH = 0.25


@dataclass(frozen=True, eq=False)
class KeyframeSolver:
    """Solves for the displacements of keyframes; picklable, for worker processes.

    Parameters
    ----------
    constraints : PoseConstraints
        Measures displacements in poses.
    guards : list of GeodesicField
        Of the reference frame, about every vertex at which an anchor is detected.
    poses : list of list of int
        Frames that each keyframe must serve.
    """

    constraints: PoseConstraints
    guards: list[GeodesicField]
    poses: list[list[int]]

    def solve(
        self,
        j: int,
        d: FloatArray,
        known: dict[int, Measured],
        rounds: int,
        measure: Callable[[Iterable[PoseTask]], Iterator[Measured]],
    ) -> tuple[FloatArray, dict[int, Measured]]:
        """Find the displacement that serves the poses of keyframe j best, starting from another.

        Parameters
        ----------
        d : (3 n,) float64
            Where to start.
        known : dict of Measured
            Poses whose constraints under `d` are known, or good enough, by frame.
        rounds : int
            Of measuring and solving.
        measure : callable
            Calls `constraints` for each of some tasks.

        Returns
        -------
        d : (3 n,) float64
        known : dict of Measured
            The last measurements of the keyframe's poses.
        """
        transfer, width = self.constraints.transfer, self.constraints.parameters.width
        V, F = transfer.surface
        poses = self.poses[j]
        points = [self.constraints.displaced[t].points for t in poses]
        carried = [(P, transfer.deformation.gradients(P)) for P in points]
        energy = self._guarded(energy_over_poses(carried, V, F, width), poses)
        some_poses = carried[:: max(1, (len(poses) - 1) // 2)]
        smoother = FoldSmoother(F, transfer.root_area, some_poses)
        known = {t: known[t] for t in poses if t in known}
        for turn in range(rounds):
            # The last keyframe's constraints are as good as new: its displacement followed from
            # them.
            asked = poses if turn > 0 else [t for t in poses if t not in known]
            # The distances of a pose are measured once.
            tasks = [(t, d, known[t][1] if t in known else None) for t in asked]
            known.update(zip(asked, measure(tasks), strict=True))
            constraints = [known[t][0] for t in poses]
            found = solve_displacement(constraints, energy, MOVE_REACH * width, d)
            d = smoother.smooth_folds(d + (RELAXATION if d.any() else 1.0) * (found - d))
        return d, known

    def _guarded(self, energy: DisplacementEnergy, poses: list[int]) -> DisplacementEnergy:
        """Make moves dear about the anchors that some poses show."""
        shown = np.concatenate([self.constraints.pose_vertices[t] for t in poses])
        for guard in self.guards:
            H = guard.H[np.isin(guard.anchors, shown)]
            energy.blocks[guard.component.vertices] *= guard_weights(H)[:, None, None]
        return energy


@dataclass(frozen=True, eq=False)
class _GoOneWay:
    """Solves keyframe after keyframe from one that is solved, and writes down what it finds."""

    solver: KeyframeSolver
    solved: ScratchFile
    start: FloatArray
    known: dict[int, Measured] = field(repr=False)

    def __call__(self, way: range) -> None:
        d, known = self.start, self.known
        measure = partial(map, self.solver.constraints)
        for j in way:
            d, known = self.solver.solve(j, d, known, LATER_KEYFRAME_ROUNDS, measure)
            self.solved.write(j, d)


def solve_keyframes(solver: KeyframeSolver, jobs: int) -> ScratchFile:
    """Find the displacements of all keyframes, J arrays (n, 3), from the middle one outwards.

    The keyframes before it and those after it do not wait for each other: two processes go the
    two ways.
    """
    poses, n_points = solver.poses, len(solver.constraints.transfer.surface[0])
    start = len(poses) // 2
    solved = ScratchFile.create(len(poses), n_points, DOUBLE)
    with Workers(solver.constraints, min(jobs, len(poses[start]))) as workers:
        d, known = solver.solve(
            start, np.zeros(3 * n_points), {}, FIRST_KEYFRAME_ROUNDS, workers.map
        )
    solved.write(start, d)
    both = range(start + 1, len(poses)), range(start - 1, -1, -1)
    ways = [way for way in both if way]
    beside = {t for way in ways for j in way[:1] for t in poses[j]}
    known = {t: measured for t, measured in known.items() if t in beside}
    for _ in ordered_map(_GoOneWay(solver, solved, d, known), ways, jobs=jobs, seconds=np.inf):
        pass
    return solved
