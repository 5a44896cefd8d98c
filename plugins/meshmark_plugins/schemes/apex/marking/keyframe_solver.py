"""Displacements of key frames, solved one after the other from where the last one led."""

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
from meshmark_plugins.schemes.apex.marking.energy import Energy, energy_over_poses, guarded
from meshmark_plugins.schemes.apex.marking.pose_constraints import AskPose, Measured, Work
from meshmark_plugins.schemes.apex.marking.solve_displacement import Demand, displacement
from meshmark_plugins.schemes.apex.marking.unfold import Folds

Asking = Workers[Work, Any]

# Rounds of measuring and solving at the key that all others start from, and at those.
FIRST_ROUNDS, LATER_ROUNDS = 4, 2
# Rounds after which distances are measured anew; in between they are carried over.
MEASURED_EVERY = 2
# How far a round goes from the displacement it measured to the one it found. Chips follow moves
# in proportion only nearby: whole steps overshoot, and the rounds swing to and fro.
STEP = 0.5
# Length beyond which moves become dear, in bins.
REACH = 0.25


@dataclass(eq=False)
class Chain:
    """Solves key after key; what was measured in a pose serves the next key as well.

    Parameters
    ----------
    ask : AskPose
        Measures displacements in poses.
    guards : list of Neighbourhood
        Of the reference frame, about every place where an anchor is seen.
    workers : Workers
        Which do the measuring.
    asked : dict of (Demand, Measured)
        What the poses of the last key asked for, and their distances, by frame.
    """

    ask: AskPose
    guards: list[GeodesicField]
    workers: Asking
    asked: dict[int, tuple[Demand, Measured]] = field(default_factory=dict)

    def solve(self, poses: list[int], d: FloatArray, rounds: int) -> FloatArray:
        """Find the displacement that serves some poses best, (3 N,), starting from another."""
        cover, width = self.ask.cover, self.ask.parameters.width
        points = [self.ask.animation[t].points for t in poses]
        carried = [(P, cover.deformation.gradients(P)) for P in points]
        energy = self._guarded(energy_over_poses(carried, cover.V, cover.F, width), poses)
        folds = Folds(cover.F, cover.root_area, carried[:: max(1, (len(poses) - 1) // 2)])
        # What the last key was asked for is as good as new: it went where that led.
        self.asked = {t: self.asked[t] for t in poses if t in self.asked}
        self._ask([t for t in poses if t not in self.asked], d)
        for turn in range(rounds):
            if turn > 0:
                self._ask(poses, d, anew=turn % MEASURED_EVERY == 0)
            demands = [self.asked[t][0] for t in poses]
            found = displacement(demands, energy, REACH * width, d)
            d = folds.ironed(d + (STEP if d.any() else 1.0) * (found - d))
        # What one pose would have to hold back is held back in all: a move that comes and goes
        # is seen, one that is shorter is not.
        shares = list(self.workers.map([("share", t, d, None) for t in poses]))
        return d * np.repeat(np.min(shares, axis=0), 3)

    def _ask(self, poses: list[int], d: FloatArray, anew: bool = True) -> None:
        """Ask poses what they want of a displacement, distances measured anew or carried over."""
        work: list[Work] = [("demand", t, d, None if anew else self.asked[t][1]) for t in poses]
        self.asked.update(zip(poses, self.workers.map(work), strict=True))

    def _guarded(self, energy: Energy, poses: list[int]) -> Energy:
        """Make moves dear about the anchors that some poses show."""
        shown = np.concatenate([self.ask.anchors[t] for t in poses])
        for guard in self.guards:
            H = guard.H[np.isin(guard.anchors, shown)]
            energy.blocks[guard.component.vertices] *= guarded(H)[:, None, None]
        return energy


def solve_keys(
    ask: AskPose, guards: list[GeodesicField], workers: Asking, posed: list[list[int]], jobs: int
) -> ScratchFile:
    """Find the displacements of all keys, J arrays (N, 3), from the middle one outwards.

    The keys before it and those after it do not wait for each other: while one displacement is
    solved for here, workers measure what the other way asks.

    Parameters
    ----------
    ask, guards, workers
        See `Chain`.
    posed : list of list of int
        Frames that each key must serve.
    jobs : int
        1 to go the two ways one after the other.
    """
    start = len(posed) // 2
    first = Chain(ask, guards, workers)
    solved = ScratchFile.create(len(posed), len(ask.cover.V), DOUBLE)
    middle = first.solve(posed[start], np.zeros(ask.cover.V.size), FIRST_ROUNDS)
    solved.write(start, middle)

    stopped = Event()

    def go(way: range) -> None:
        chain, d = Chain(ask, guards, workers, first.asked), middle
        for j in way:
            if stopped.is_set():
                return
            d = chain.solve(posed[j], d, LATER_ROUNDS)
            solved.write(j, d)

    ways = (range(start + 1, len(posed)), range(start - 1, -1, -1))
    with ThreadPoolExecutor(min(jobs, len(ways))) as threads:
        try:
            for done in as_completed([threads.submit(go, way) for way in ways]):
                done.result()
        except BaseException:
            # Nobody wants the rest of the other way any more.
            stopped.set()
            raise
    return solved
