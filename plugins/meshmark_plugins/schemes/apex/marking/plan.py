"""The plan of an animation's mark: displacements at key frames, blended in between."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.flip_guard import restrain
from meshmark.metrics.surface_distance import surface_distance
from meshmark.workers.ordered_map import Workers, ordered_map
from meshmark.workers.scratch import ScratchFile
from meshmark_plugins.schemes.apex.anchors.geodesic_field import geodesic_fields
from meshmark_plugins.schemes.apex.anchors.track import (
    FrameAnchors,
    anchors_in_poses,
    lasting_anchors,
)
from meshmark_plugins.schemes.apex.marking.anchor_words import Layout, lay_out
from meshmark_plugins.schemes.apex.marking.fit_to_surface import refit
from meshmark_plugins.schemes.apex.marking.keyframe_solver import solve_keys
from meshmark_plugins.schemes.apex.marking.pose_constraints import AskPose, Cover, held_chips
from meshmark_plugins.schemes.apex.parameters import Parameters

# Poses looked at for each key frame: chips change from one pose to the next by as much as a mark
# moves them, so that each pose left out is one badly served.
POSES = 20
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
    displacements : ScratchFile
        Of each key, J arrays (N, 3) in root areas of the reference frame. Copies of the plan in
        other processes read the same file, which goes with this one.
    carriers : int
        Number of anchors.
    scale : float
        Share of the displacements that is applied.
    """

    cover: Cover
    keys: FloatArray
    displacements: ScratchFile
    carriers: int
    scale: float = 1.0

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
        return (1.0 - share) * self._key(before) + share * self._key(after)

    def _key(self, j: int) -> FloatArray:
        return self.scale * self.displacements.read(j).ravel()


def require_capacity(frame_anchors: FrameAnchors, parameters: Parameters) -> Layout:
    """Find the anchors to be marked, and how.

    Raises
    ------
    CapacityError
        If they cannot hold a mark, with the reason and what to do.
    """
    animation = frame_anchors.animation
    anchors = lasting_anchors(frame_anchors, parameters.words)
    layout = lay_out(animation, anchors, parameters, frame_anchors.jobs)
    first = animation[0]
    held = held_chips(first.points, first.faces, layout, parameters)
    if held < FEWEST_CHIPS:
        raise CapacityError(
            f"{len(first.points)} points give {held} chips, and a proof at one in a million takes "
            f"{FEWEST_CHIPS}: the mesh is too coarse, or too little of it sticks out; subdivide "
            "it, or choose another scheme"
        )
    return layout


def plan_animation(
    animation: MeshAnimation, words: IntArray, parameters: Parameters, jobs: int
) -> SurfacePlan:
    """Plan the mark of an animation of one topology.

    Raises
    ------
    CapacityError
        If it cannot hold one, with the reason and what to do.
    """
    frame_anchors = FrameAnchors(animation, jobs)
    layout = require_capacity(frame_anchors, parameters)
    first = animation[0]
    cover = Cover(first.points, first.faces)
    keys = key_frames(len(animation), parameters.hold)
    posed = [poses_about(keys, j, len(animation)) for j in range(len(keys))]
    anchors = anchors_in_poses(frame_anchors, layout.anchors, sorted(set().union(*posed)))
    ask = AskPose(animation, cover, layout, words[layout.words], parameters, anchors)
    guards = geodesic_fields(cover.V, cover.F, np.unique(np.concatenate(list(anchors.values()))))
    with Workers(ask, min(jobs, len(animation))) as workers:
        solved = solve_keys(ask, guards, workers, posed, jobs)
    plan = SurfacePlan(cover, keys, solved, len(layout.anchors))
    return within_limit(plan, animation, parameters.max_mrms, jobs)


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


def within_limit(
    plan: SurfacePlan, animation: MeshAnimation, max_mrms: float, jobs: int = 1
) -> SurfacePlan:
    """Weaken a plan until it distorts no more than it may."""
    count = min(TRIALS, len(animation))
    trials = np.unique(np.linspace(0, len(animation) - 1, count).round().astype(np.int64))
    while True:
        mrms = ordered_map(_MeasureMRMS(plan, animation), trials.tolist(), jobs=jobs)
        if (mean := float(np.mean(list(mrms)))) <= max_mrms:
            return plan
        plan = replace(plan, scale=plan.scale * BELOW * max_mrms / mean)


@dataclass(frozen=True, eq=False)
class _MeasureMRMS:
    """Measures how far a plan moves the surface of frame after frame, as a share of its size."""

    plan: SurfacePlan
    animation: MeshAnimation

    def __call__(self, index: int) -> float:
        frame = self.animation[index]
        X = self.plan.mark(index, frame)
        found = surface_distance(frame.points, frame.faces, X, frame.faces, samples=TRIAL_POINTS)
        return found.mrms / found.diagonal
