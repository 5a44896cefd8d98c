"""The plan of an animation's mark: displacements at key frames, blended in between."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.animation import Frame, MeshAnimation
from meshmark.errors import CapacityError
from meshmark.parallel import Workers
from meshmark.restraint import restrain
from meshmark.surface import ClosestPoints
from meshmark.surface_distance import surface_distance
from meshmark_plugins.schemes.apex.consensus import anchors_in_poses, lasting_anchors
from meshmark_plugins.schemes.apex.displacement import Demand, displacement
from meshmark_plugins.schemes.apex.energy import energy_over_poses, guarded
from meshmark_plugins.schemes.apex.folds import Folds
from meshmark_plugins.schemes.apex.layout import Layout, lay_out
from meshmark_plugins.schemes.apex.poses import AskPose, Cover, Question, held_chips
from meshmark_plugins.schemes.apex.refit import refit
from meshmark_plugins.schemes.apex.survey import Neighbourhood, measure_from
from meshmark_plugins.schemes.apex.tuning import Tuning

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Poses looked at for each key frame: chips change from one pose to the next by as much as a mark
# moves them, so that each pose left out is one badly served.
POSES = 20
# Rounds of measuring and solving at the first key frame, and at those that start from it.
FIRST_ROUNDS, LATER_ROUNDS = 4, 2
# How far a round goes from the displacement it measured to the one it found. Chips follow moves
# in proportion only nearby: whole steps overshoot, and the rounds swing to and fro.
STEP = 0.5
# Length beyond which moves become dear, in bins.
REACH = 0.25
# Fewer chips than this could not prove anything at one in a million, readings and words paid.
FEWEST_CHIPS = 40
# Frames whose distortion is measured, and points of the surface, to keep within the limit.
TRIALS, TRIAL_POINTS = 4, 20_000
# Distortion aimed at when it must be lowered, as a share of the limit.
BELOW = 0.97


@dataclass(frozen=True, eq=False)
class SurfacePlan:
    """Displacements of the surface at key frames.

    Parameters
    ----------
    cover : Cover
        Carries displacements to other frames.
    keys : (J,) float64
        Frame of each key, increasing.
    displacements : (J, 3 N) float64
        In root areas of the reference frame.
    carriers : int
        Number of anchors.
    """

    cover: Cover
    keys: FloatArray
    displacements: FloatArray
    carriers: int

    def mark(self, index: int, frame: Frame) -> FloatArray:
        """Return the marked positions (N, 3) of frame `index`."""
        P, F = frame.points, frame.faces
        original = ClosestPoints(P, F)
        X, _ = self.cover.laid(P, self.at(index), original)
        return restrain(P, refit(X, F, original), F, np.inf)

    def at(self, index: int) -> FloatArray:
        """Blend the displacements of the keys before and after a frame, (3 N,)."""
        place = np.interp(index, self.keys, np.arange(len(self.keys)))
        before = int(min(np.floor(place), len(self.keys) - 1))
        after = min(before + 1, len(self.keys) - 1)
        share = place - before
        blended: FloatArray = (1.0 - share) * self.displacements[
            before
        ] + share * self.displacements[after]
        return blended


def require_capacity(animation: MeshAnimation, tuning: Tuning, jobs: int) -> Layout:
    """Find the anchors to be marked, and how.

    Raises
    ------
    CapacityError
        If they cannot hold a mark, with the reason and what to do.
    """
    anchors = lasting_anchors(animation, tuning.words, jobs)
    layout = lay_out(animation, anchors, tuning)
    first = animation[0]
    held = held_chips(first.points, first.faces, layout, tuning)
    if held < FEWEST_CHIPS:
        raise CapacityError(
            f"{len(first.points)} points give {held} chips, and a proof at one in a million takes "
            f"{FEWEST_CHIPS}: the mesh is too coarse, or too little of it sticks out; subdivide "
            "it, or choose another scheme"
        )
    return layout


def plan_animation(
    animation: MeshAnimation, words: IntArray, tuning: Tuning, jobs: int
) -> SurfacePlan:
    """Plan the mark of an animation of one topology.

    Raises
    ------
    CapacityError
        If it cannot hold one, with the reason and what to do.
    """
    layout = require_capacity(animation, tuning, jobs)
    first = animation[0]
    cover = Cover(first.points, first.faces)
    keys = key_frames(len(animation), tuning.hold)
    posed = [poses_about(keys, j, len(animation)) for j in range(len(keys))]
    anchors = anchors_in_poses(animation, layout.anchors, sorted(set().union(*posed)), jobs)
    ask = AskPose(animation, cover, layout, words[layout.words], tuning, anchors)
    guards = measure_from(cover.V, cover.F, np.unique(np.concatenate(list(anchors.values()))))
    solved: list[FloatArray] = []
    with Workers(ask, min(jobs, POSES, len(animation))) as workers:
        for poses in posed:
            start = solved[-1] if solved else np.zeros(first.points.size)
            rounds = LATER_ROUNDS if solved else FIRST_ROUNDS
            solved.append(_solve(ask, guards, workers, poses, start, rounds))
    plan = SurfacePlan(cover, keys, np.array(solved), len(layout.anchors))
    return within_limit(plan, animation, tuning.max_mrms)


def key_frames(n_frames: int, hold: int) -> FloatArray:
    """Spread key frames evenly, `hold` frames apart or somewhat more, (J,) float64."""
    n_keys = 1 + (n_frames - 1) // hold
    return np.linspace(0.0, n_frames - 1.0, n_keys) if n_keys > 1 else np.zeros(1)


def poses_about(keys: FloatArray, j: int, n_frames: int) -> list[int]:
    """Choose the frames a key's displacement must serve: up to those of its neighbours."""
    low = keys[j - 1] if j > 0 else 0.0
    high = keys[j + 1] if j + 1 < len(keys) else n_frames - 1.0
    spread = np.linspace(low, high, min(POSES, int(high - low) + 1))
    return [int(t) for t in np.unique(spread.round())]


def _solve(
    ask: AskPose,
    guards: list[Neighbourhood],
    workers: Workers[tuple[Question, int, FloatArray], Any],
    poses: list[int],
    d: FloatArray,
    rounds: int,
) -> FloatArray:
    """Find the displacement that serves some poses best, (3 N,)."""
    cover, width = ask.cover, ask.tuning.width
    points = [ask.animation[t].points for t in poses]
    carried = [(P, cover.deformation.gradients(P)) for P in points]
    energy = energy_over_poses(carried, cover.V, cover.F, width)
    shown = np.concatenate([ask.anchors[t] for t in poses])
    for near in guards:
        H = near.H[np.isin(near.anchors, shown)]
        energy.blocks[near.piece.vertices] *= guarded(H)[:, None, None]
    folds = Folds(cover.F, cover.root_area, carried[:: max(1, (len(carried) - 1) // 2)])
    for _ in range(rounds):
        demands: list[Demand] = list(workers.map([("demand", t, d) for t in poses]))
        found = displacement(demands, energy, REACH * width, d)
        step = STEP if d.any() else 1.0
        d = folds.ironed(d + step * (found - d))
    # What one pose would have to hold back is held back in all: a move that comes and goes is
    # seen, one that is shorter is not.
    shares = list(workers.map([("share", t, d) for t in poses]))
    return d * np.repeat(np.min(shares, axis=0), 3)


def within_limit(plan: SurfacePlan, animation: MeshAnimation, max_mrms: float) -> SurfacePlan:
    """Weaken a plan until it distorts no more than it may."""
    count = min(TRIALS, len(animation))
    trials = np.unique(np.linspace(0, len(animation) - 1, count).round().astype(np.int64))
    while (mrms := _mean_mrms(plan, animation, trials.tolist())) > max_mrms:
        weaker = plan.displacements * (BELOW * max_mrms / mrms)
        plan = replace(plan, displacements=weaker)
    return plan


def _mean_mrms(plan: SurfacePlan, animation: MeshAnimation, frames: list[int]) -> float:
    values = []
    for t in frames:
        frame = animation[t]
        X = plan.mark(t, frame)
        found = surface_distance(frame.points, frame.faces, X, frame.faces, samples=TRIAL_POINTS)
        values.append(found.mrms / found.diagonal)
    return float(np.mean(values))
