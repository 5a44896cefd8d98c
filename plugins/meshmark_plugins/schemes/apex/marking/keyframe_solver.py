"""Displacements of keyframes, each solved for from where its neighbour's led."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, field
from threading import Event
from typing import Any

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.workers.ordered_map import Workers
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

PoseWorkers = Workers[PoseTask, Any]

# Rounds of measuring and solving at the keyframe that all others start from, and at those.
FIRST_KEYFRAME_ROUNDS, LATER_KEYFRAME_ROUNDS = 4, 2
# Share of the way from the displacement it measured to the one it solved for that a round goes.
# Chips follow moves in proportion only nearby: whole steps overshoot, and the rounds swing to and
# fro.
RELAXATION = 0.5
# Length beyond which moves become dear, in bins.
MOVE_REACH = 0.25


@dataclass(eq=False)
class KeyframeSolver:
    """Solves keyframe after keyframe; what was measured in a pose serves the next one as well.

    Parameters
    ----------
    constraints : PoseConstraints
        Measures displacements in poses.
    guards : list of GeodesicField
        Of the reference frame, about every vertex at which an anchor is detected.
    workers : Workers
        Which do the measuring.
    cache : dict of (LinearConstraints, object)
        Constraints of the poses of the last keyframe, and their distances, by frame.
    """

    constraints: PoseConstraints
    guards: list[GeodesicField]
    workers: PoseWorkers
    cache: dict[int, tuple[LinearConstraints, Any]] = field(default_factory=dict)

    def solve(self, poses: list[int], d: FloatArray, rounds: int) -> FloatArray:
        """Find the displacement that serves some poses best, (3 n,), starting from another."""
        transfer, width = self.constraints.transfer, self.constraints.parameters.width
        V, F = transfer.surface
        points = [transfer.positions(self.constraints.animation[t].points) for t in poses]
        carried = [(P, transfer.deformation.gradients(P)) for P in points]
        energy = self._guarded(energy_over_poses(carried, V, F, width), poses)
        some_poses = carried[:: max(1, (len(poses) - 1) // 2)]
        smoother = FoldSmoother(F, transfer.root_area, some_poses)
        # The last keyframe's constraints are as good as new: its displacement followed from them.
        self.cache = {t: self.cache[t] for t in poses if t in self.cache}
        self._measure([t for t in poses if t not in self.cache], d)
        for turn in range(rounds):
            if turn > 0:
                self._measure(poses, d)
            constraints = [self.cache[t][0] for t in poses]
            found = solve_displacement(constraints, energy, MOVE_REACH * width, d)
            d = smoother.smooth_folds(d + (RELAXATION if d.any() else 1.0) * (found - d))
        return d

    def _measure(self, poses: list[int], d: FloatArray) -> None:
        """Measure a displacement in poses; their distances once."""
        tasks: list[PoseTask] = [
            (t, d, self.cache[t][1] if t in self.cache else None) for t in poses
        ]
        self.cache.update(zip(poses, self.workers.map(tasks), strict=True))

    def _guarded(self, energy: DisplacementEnergy, poses: list[int]) -> DisplacementEnergy:
        """Make moves dear about the anchors that some poses show."""
        shown = np.concatenate([self.constraints.pose_vertices[t] for t in poses])
        for guard in self.guards:
            H = guard.H[np.isin(guard.anchors, shown)]
            energy.blocks[guard.component.vertices] *= guard_weights(H)[:, None, None]
        return energy


def solve_keyframes(
    constraints: PoseConstraints,
    guards: list[GeodesicField],
    workers: PoseWorkers,
    poses: list[list[int]],
    jobs: int,
) -> ScratchFile:
    """Find the displacements of all keyframes, J arrays (n, 3), from the middle one outwards.

    The keyframes before it and those after it do not wait for each other: while one displacement
    is solved for here, workers measure poses for the other way.

    Parameters
    ----------
    constraints, guards, workers
        See `KeyframeSolver`.
    poses : list of list of int
        Frames that each keyframe must serve.
    jobs : int
        1 to go the two ways one after the other.
    """
    start = len(poses) // 2
    first = KeyframeSolver(constraints, guards, workers)
    V, _ = constraints.transfer.surface
    solved = ScratchFile.create(len(poses), len(V), DOUBLE)
    middle = first.solve(poses[start], np.zeros(V.size), FIRST_KEYFRAME_ROUNDS)
    solved.write(start, middle)

    stopped = Event()

    def go(way: range) -> None:
        solver, d = KeyframeSolver(constraints, guards, workers, first.cache), middle
        for j in way:
            if stopped.is_set():
                return
            d = solver.solve(poses[j], d, LATER_KEYFRAME_ROUNDS)
            solved.write(j, d)

    ways = (range(start + 1, len(poses)), range(start - 1, -1, -1))
    with ThreadPoolExecutor(min(jobs, len(ways))) as threads:
        try:
            for done in as_completed([threads.submit(go, way) for way in ways]):
                done.result()
        except BaseException:
            # Nobody wants the rest of the other way any more.
            stopped.set()
            raise
    return solved
