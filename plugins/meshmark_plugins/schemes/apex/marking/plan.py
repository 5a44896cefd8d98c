"""The plan of an animation's mark: displacements at keyframes, blended in between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.flip_guard import restrain
from meshmark.mesh.frame_range import spread
from meshmark.metrics.summary import standard_error
from meshmark.metrics.surface_distance import surface_distance
from meshmark.workers.ordered_map import ordered_map
from meshmark.workers.scratch import DOUBLE, ScratchFile
from meshmark_plugins.schemes.apex.anchors.geodesic_field import geodesic_fields
from meshmark_plugins.schemes.apex.anchors.track import (
    FrameAnchors,
    anchors_in_poses,
    lasting_anchors,
)
from meshmark_plugins.schemes.apex.marking.displacement_transfer import (
    RAMP,
    DisplacementTransfer,
)
from meshmark_plugins.schemes.apex.marking.fit_to_surface import fit_to_surface
from meshmark_plugins.schemes.apex.marking.keyframe_solver import (
    KeyframeSolver,
    solve_keyframes,
)
from meshmark_plugins.schemes.apex.marking.marked_anchors import (
    MarkedAnchors,
    assign_units_and_words,
    count_usable_chips,
)
from meshmark_plugins.schemes.apex.marking.planning_proxy import planning_proxy
from meshmark_plugins.schemes.apex.marking.pose_constraints import PoseConstraints
from meshmark_plugins.schemes.apex.parameters import Parameters

# Poses measured for each keyframe: chips change from one pose to the next by as much as a mark
# moves them, so that each pose left out is one badly served.
MAX_POSES_PER_KEYFRAME = 20
# Fewer chips than this prove nothing at one in a million, multiple testing over hypotheses and
# words taken into account.
MIN_CHIPS = 40
# Points of what is displaced that are remembered, of many frames or few: poses of a keyframe are
# measured again and again.
REMEMBERED_POINTS = 400_000
# Frames whose distortion is measured first, and points of the surface, to keep within the limit;
# more frames are measured unless it is so many standard errors away.
MRMS_FRAMES, MRMS_SAMPLES, MRMS_DOUBT = 4, 20_000, 2.0
# Distortion aimed at when it must be lowered, as a share of the limit.
MRMS_AIM = 0.97

# A file of positions, and which of its frames.
Kept: TypeAlias = tuple[ScratchFile, int]


@dataclass(frozen=True, eq=False)
class SurfacePlan:
    """Displacements of the surface at keyframes.

    Parameters
    ----------
    transfer : DisplacementTransfer
        Transfers displacements to other frames.
    keyframes : (J,) float64
        Frame of each keyframe, increasing; a fraction where it lies between two.
    displacements : ScratchFile
        Of each keyframe, J arrays (n, 3) in root areas of the reference frame. Copies of the plan
        in other processes read the same file, which goes with this one.
    carriers : int
        Number of anchors.
    shares : ScratchFile, optional
        How much of each displacement is left to each vertex, J arrays (N, 1); all by default.
    scale : float
        Share of the displacements that is applied.
    known : mapping of int to (ScratchFile, int)
        Frames that were marked when their distortion was measured: where marked positions are kept.
    """

    transfer: DisplacementTransfer
    keyframes: FloatArray
    displacements: ScratchFile
    carriers: int
    shares: ScratchFile | None = None
    scale: float = 1.0
    known: Mapping[int, Kept] = field(default_factory=dict)

    def mark(self, index: int, frame: Frame) -> FloatArray:
        """Return the marked positions (N, 3) of frame `index`."""
        if index in self.known:
            kept, place = self.known[index]
            return kept.read(place)
        P, F = frame.points, frame.faces
        original = self.transfer.closest_points(P)
        X, _, face = self.transfer.apply(P, self.displacement(index), original, self.share(index))
        return restrain(P, fit_to_surface(X, F, original, face), F, np.inf, RAMP)

    def displacement(self, index: int) -> FloatArray:
        """Blend the displacements of the keyframes before and after a frame, (3 n,)."""
        return self._blend(self.displacements, index, self.scale)

    def share(self, index: int) -> FloatArray | float:
        """Blend the shares of the keyframes before and after a frame that are left, (N,)."""
        return 1.0 if self.shares is None else self._blend(self.shares, index)

    def _blend(self, kept: ScratchFile, index: int, scale: float = 1.0) -> FloatArray:
        last = len(self.keyframes) - 1
        j = np.interp(index, self.keyframes, np.arange(len(self.keyframes)))
        before = int(min(np.floor(j), last))
        share = j - before
        of_before, of_after = (
            scale * kept.read(j).ravel() for j in (before, min(before + 1, last))
        )
        return (1.0 - share) * of_before + share * of_after


def require_capacity(frame_anchors: FrameAnchors, parameters: Parameters) -> MarkedAnchors:
    """Select the anchors to be marked, with their units and words.

    Raises
    ------
    CapacityError
        If they cannot hold a mark, with the reason and what to do.
    """
    animation = frame_anchors.animation
    vertices = lasting_anchors(frame_anchors, parameters.words)
    first, proxies, jobs = animation[0], frame_anchors.proxies, frame_anchors.jobs
    anchors = assign_units_and_words(animation, vertices, parameters, jobs, proxies)
    chips = count_usable_chips(first.points, first.faces, anchors, parameters, proxies)
    if chips < MIN_CHIPS:
        raise CapacityError(
            f"{len(first.points)} points give {chips} chips, and a proof at one in a million takes "
            f"{MIN_CHIPS}: the mesh is too coarse, or too little of it sticks out; subdivide "
            "it, or choose another scheme"
        )
    return anchors


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
    anchors = require_capacity(frame_anchors, parameters)
    first = animation[0]
    proxies = frame_anchors.proxies
    planning = planning_proxy(first.points, first.faces, anchors.vertices, proxies)
    transfer = DisplacementTransfer(first.points, first.faces, planning.proxy)
    keyframes = spread_keyframes(len(animation), parameters.hold)
    poses = [poses_of_keyframe(keyframes, j, len(animation)) for j in range(len(keyframes))]
    served = sorted(set().union(*poses))
    seen = anchors_in_poses(frame_anchors, anchors.vertices, served)
    shown = np.unique(np.concatenate(list(seen.values())))
    guards = geodesic_fields(transfer.V, transfer.F, shown, proxies=proxies)
    guards = [planning.of_proxy(guard) for guard in guards]
    own_words = words[anchors.words]
    few = REMEMBERED_POINTS // len(transfer.surface[0])
    displaced = animation.map(transfer.displaced).remembered(few)
    constraints = PoseConstraints(
        animation,
        transfer,
        displaced,
        anchors,
        own_words,
        parameters,
        seen,
        {t: frame_anchors.pose(t) for t in served},
        frame_anchors.distances,
        planning,
        proxies,
    )
    solved = solve_keyframes(KeyframeSolver(constraints, guards, poses), jobs)
    plan = SurfacePlan(transfer, keyframes, solved, len(anchors.vertices))
    plan = hold_back(plan, animation, poses, jobs)
    return limit_mrms(plan, animation, parameters.max_mrms, jobs)


def spread_keyframes(n_frames: int, keyframe_interval: int) -> FloatArray:
    """Spread keyframes evenly, an interval of frames apart or somewhat more, (J,) float64."""
    n_keyframes = 1 + (n_frames - 1) // keyframe_interval
    return np.linspace(0.0, n_frames - 1.0, n_keyframes) if n_keyframes > 1 else np.zeros(1)


def poses_of_keyframe(keyframes: FloatArray, j: int, n_frames: int) -> list[int]:
    """Choose the frames that a keyframe's displacement must serve: up to its neighbours."""
    low = keyframes[j - 1] if j > 0 else 0.0
    high = keyframes[j + 1] if j + 1 < len(keyframes) else n_frames - 1.0
    between = np.linspace(low, high, min(MAX_POSES_PER_KEYFRAME, int(high - low) + 1))
    return [int(t) for t in np.unique(between.round())]


def hold_back(
    plan: SurfacePlan, animation: MeshAnimation, poses: list[list[int]], jobs: int = 1
) -> SurfacePlan:
    """Hold back in all poses of a keyframe what one of them would have to hold back.

    A move that comes and goes is seen, one that is shorter is not.

    Parameters
    ----------
    poses : list of list of int
        Frames that each keyframe serves.
    """
    shares = ScratchFile.create(len(poses), len(plan.transfer.V), width=1)
    for j in range(len(poses)):
        shares.write(j, np.ones(len(plan.transfer.V)))
    frames = sorted(set().union(*poses))
    left = ordered_map(_MeasureShares(plan, animation), frames, jobs=jobs)
    for t, share in zip(frames, left, strict=True):
        for j in (j for j, served in enumerate(poses) if t in served):
            shares.write(j, np.minimum(shares.read(j).ravel(), share))
    return replace(plan, shares=shares)


@dataclass(frozen=True, eq=False)
class _MeasureShares:
    """Measures how much of its move a plan leaves to each vertex of a frame, (N,)."""

    plan: SurfacePlan
    animation: MeshAnimation

    def __call__(self, index: int) -> FloatArray:
        P = self.animation[index].points
        original = self.plan.transfer.closest_points(P)
        return self.plan.transfer.apply(P, self.plan.displacement(index), original)[1]


def limit_mrms(
    plan: SurfacePlan, animation: MeshAnimation, max_mrms: float, jobs: int = 1
) -> SurfacePlan:
    """Weaken a plan until it distorts no more than it may, on average over all frames.

    What was marked to measure that need not be marked again.
    """
    while True:
        mean, known = _mean_mrms(plan, animation, max_mrms, jobs)
        if mean <= max_mrms:
            return replace(plan, known=known)
        scale = plan.scale * MRMS_AIM * max_mrms / mean
        plan = replace(plan, scale=scale, known={})


def _mean_mrms(
    plan: SurfacePlan, animation: MeshAnimation, limit: float, jobs: int
) -> tuple[float, dict[int, Kept]]:
    """Average MRMS over a few frames, and over more of them while the limit is in doubt.

    Returns
    -------
    mean : float
        As a share of the diagonal.
    known : dict of int to Kept
        The marked positions of these frames.
    """
    n_frames = len(animation)
    found: dict[int, tuple[float, float]] = {}
    known: dict[int, Kept] = {}
    most = MRMS_FRAMES
    while True:
        more = [t for t in spread(n_frames, most) if t not in found]
        kept = ScratchFile.create(len(more), len(plan.transfer.V), DOUBLE)
        known.update({t: (kept, place) for place, t in enumerate(more)})
        measure = _MeasureMRMS(plan, animation, known)
        found.update(zip(more, ordered_map(measure, more, jobs=jobs), strict=True))
        mrms, errors = np.array(list(found.values())).T
        mean, doubt = float(mrms.mean()), MRMS_DOUBT * standard_error(mrms, errors, n_frames)
        if abs(mean - limit) > doubt or len(found) == n_frames:
            return mean, known
        most = 2 * most - 1


@dataclass(frozen=True, eq=False)
class _MeasureMRMS:
    """Measures by what share of its size a plan moves the surface of a frame, and the error.

    The marked positions are kept where `known` says.
    """

    plan: SurfacePlan
    animation: MeshAnimation
    known: Mapping[int, Kept]

    def __call__(self, index: int) -> tuple[float, float]:
        frame, order = self.animation[index], self.plan.transfer.order
        X = self.plan.mark(index, frame)
        kept, place = self.known[index]
        kept.write(place, X)
        found = surface_distance(
            frame.points, frame.faces, X, frame.faces, samples=MRMS_SAMPLES, order=order
        )
        return found.mrms / found.diagonal, found.mrms_error / found.diagonal
