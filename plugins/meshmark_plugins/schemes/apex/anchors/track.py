"""Tracking of anchors: those detected in nearly every frame, and again after smoothing."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.smoothing import polygon_umbrella, smooth
from meshmark.mesh.topology import vertex_components
from meshmark.workers.ordered_map import ordered_map
from meshmark_plugins.schemes.apex.anchors.detect import (
    ComponentAnchors,
    detect_anchors,
    distance_to_border,
)
from meshmark_plugins.schemes.apex.anchors.persistence import (
    MIN_PERSISTENCE_DETECTED,
    MIN_PERSISTENCE_MARKED,
)
from meshmark_plugins.schemes.apex.anchors.pose_distances import PoseDistances
from meshmark_plugins.schemes.apex.anchors.proxies import MarkingProxies, Proxies

# Most anchors that are tracked, and frames in which they are.
MAX_TRACKED_ANCHORS, TRACKED_FRAMES = 12, 12
# Share of the frames in which an anchor must be detected.
MIN_FRAME_SHARE = 0.9
# Detections at most this far apart, in root areas, are of one anchor.
SAME_ANCHOR_DISTANCE = 0.05
# A tip nearer than this to a border, in root areas, would be one of the border's, which a crop
# moves.
MIN_BORDER_DISTANCE = 0.02
# Poses are the same whose points differ by no more, as a share of their size: a hundredth of a bin,
# or less. Points that are compared first.
SAME_POSE, FEW_POINTS = 1e-4, 64
# Iterations of smoothing after which an anchor must be detected again.
TRIAL_SMOOTHING_ITERATIONS = 10


class FrameAnchors:
    """The anchors detected in frames of an animation, in each pose once.

    Parameters
    ----------
    animation : MeshAnimation
        Frames as analysis sees them, of one topology.
    jobs : int
        Processes that work, this one among them.

    Attributes
    ----------
    distances : PoseDistances
        From the anchors of each pose.
    """

    def __init__(self, animation: MeshAnimation, jobs: int) -> None:
        self.animation, self.jobs = animation, jobs
        self._detected: dict[int, tuple[IntArray, FloatArray]] = {}
        self.distances = PoseDistances.create()
        self._poses = RecurringPoses(animation)

    @cached_property
    def proxies(self) -> Proxies:
        """The proxies of the topology."""
        first = self.animation[0]
        return MarkingProxies(first.points, first.faces)

    def of(self, frames: Sequence[int]) -> list[tuple[IntArray, FloatArray]]:
        """Return vertices and persistence of the anchors of some frames, maybe none."""
        poses = [self.pose(t) for t in frames]
        new = sorted(set(poses) - set(self._detected))
        detect = DetectInFrame(self.animation, self.proxies, self.distances)
        found = ordered_map(detect, new, jobs=self.jobs)
        self._detected.update(zip(new, found, strict=True))
        return [self._detected[t] for t in poses]

    def pose(self, index: int) -> int:
        """Return the frame in which the pose of frame `index` was looked at."""
        return self._poses.first(index)


class RecurringPoses:
    """Tells which frames show a pose that was seen before, as cycles and held poses do.

    Parameters
    ----------
    animation : MeshAnimation
        Of one topology.
    """

    def __init__(self, animation: MeshAnimation) -> None:
        self._animation = animation
        self._first: dict[int, int] = {}
        # Few points tell most poses apart.
        self._few: dict[int, FloatArray] = {}

    def first(self, index: int) -> int:
        """Return the first frame asked about that shows the pose of frame `index`, wherever it is.

        Its points lie at most `SAME_POSE` of the pose's size elsewhere.
        """
        if index not in self._first:
            P = self._centred(index)
            near = SAME_POSE * float(np.ptp(P, axis=0).max())
            few = P[:: max(1, len(P) // FEW_POINTS)].copy()
            same = (
                t
                for t, other in self._few.items()
                if np.abs(few - other).max() <= near and np.abs(P - self._centred(t)).max() <= near
            )
            self._first[index] = next(same, index)
            if self._first[index] == index:
                self._few[index] = few
        return self._first[index]

    def _centred(self, index: int) -> FloatArray:
        P = self._animation[index].points
        return P - P.mean(axis=0)


@dataclass(frozen=True, eq=False)
class DetectInFrame:
    """Detects the anchors of frame after frame; picklable, for worker processes."""

    animation: MeshAnimation
    proxies: Proxies
    distances: PoseDistances

    def __call__(self, index: int) -> tuple[IntArray, FloatArray]:
        """Return vertices and persistence of the anchors of frame `index`, maybe none.

        Distances from them are kept, as long as all is at hand that measuring them takes.
        """
        frame = self.animation[index]
        found = anchors_if_any(frame.points, frame.faces, self.proxies)
        # If that fails, whoever asks for them is told.
        with suppress(CapacityError):
            self.distances.keep(index, found)
        return _vertices_and_persistence(found)


def anchors_if_any(
    V: FloatArray, F: IntArray, proxies: Proxies | None = None
) -> list[ComponentAnchors]:
    """Detect the anchors of one mesh; none is no error here."""
    try:
        return detect_anchors(V, F, MIN_PERSISTENCE_DETECTED, MAX_TRACKED_ANCHORS, proxies)
    except CapacityError:
        return []


def _vertices_and_persistence(found: list[ComponentAnchors]) -> tuple[IntArray, FloatArray]:
    if not found:
        return np.empty(0, dtype=np.int64), np.empty(0)
    vertices = np.concatenate([each.component.vertices[each.maxima.vertices] for each in found])
    return vertices, np.concatenate([each.maxima.persistence for each in found])


def lasting_anchors(frame_anchors: FrameAnchors, max_anchors: int) -> IntArray:
    """Select the anchors worth marking.

    Parameters
    ----------
    frame_anchors : FrameAnchors
        Of the animation.
    max_anchors : int
        Most anchors to return.

    Returns
    -------
    (C,) int
        Vertices, the most persistent first.

    Raises
    ------
    CapacityError
        If none is left, with the reason.
    """
    animation = frame_anchors.animation
    count = min(TRACKED_FRAMES, len(animation))
    chosen = np.unique(np.linspace(0, len(animation) - 1, count).round().astype(np.int64))
    first = animation[0]
    V, F = first.points, first.faces
    near = SAME_ANCHOR_DISTANCE * float(np.sqrt(face_areas(V, F).sum()))
    vertices, persistence, share = _clusters(V, frame_anchors.of(chosen.tolist()), near)
    if not np.any(persistence >= MIN_PERSISTENCE_MARKED):
        raise CapacityError(
            "nothing sticks out of the mesh far enough to measure from; a mark needs tips such "
            "as hands, feet, ears or a tail: mark the mesh this one is worn by or stands on, or "
            "choose another scheme"
        )
    lasting = (persistence >= MIN_PERSISTENCE_MARKED) & (share >= MIN_FRAME_SHARE)
    clear = distance_to_border(V, F, vertices) >= near * MIN_BORDER_DISTANCE / SAME_ANCHOR_DISTANCE
    if not np.any(lasting & clear):
        raise CapacityError(
            "the only tips lie on open borders, or are not there in every frame, so that none "
            "would be found again; choose another scheme"
        )
    kept = vertices[lasting & clear]
    order = np.argsort(-persistence[lasting & clear], kind="stable")
    return _survivors(frame_anchors, kept[order], near)[:max_anchors]


def anchors_in_poses(
    frame_anchors: FrameAnchors, anchors: IntArray, frames: Sequence[int]
) -> dict[int, IntArray]:
    """Find where anchors are detected in each of some poses.

    A tip is blunt, and its middle is one vertex in one pose and a neighbour in the next: a copy
    shows the one of its pose, and distances count from there.

    Parameters
    ----------
    frame_anchors : FrameAnchors
        Of the animation.
    anchors : (C,) int
        Vertices where anchors usually are.
    frames : sequence of int
        The poses.

    Returns
    -------
    dict of (C,) int
        Vertices, by frame; the usual one where an anchor is not detected.
    """
    first = frame_anchors.animation[0]
    near = SAME_ANCHOR_DISTANCE * float(np.sqrt(face_areas(first.points, first.faces).sum()))
    piece = vertex_components(first.faces, len(first.points))
    found = {}
    for t, (vertices, _) in zip(frames, frame_anchors.of(frames), strict=True):
        gaps = cdist(first.points[anchors], first.points[vertices])
        # What another piece shows nearby is another tip.
        gaps[piece[anchors][:, None] != piece[vertices]] = np.inf
        own, theirs = linear_sum_assignment(np.minimum(gaps, 2.0 * near))
        is_near = gaps[own, theirs] <= near
        found[t] = anchors.copy()
        found[t][own[is_near]] = vertices[theirs[is_near]]
    return found


def _clusters(
    V: FloatArray, detections: list[tuple[IntArray, FloatArray]], near: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Cluster detections that lie near each other on one frame.

    Returns
    -------
    vertices : (m,) int
        The vertex of each cluster that the others are nearest to.
    persistence : (m,) float64
        Median over its detections.
    share : (m,) float64
        Share of the frames it was detected in.
    """
    members: list[list[tuple[int, float]]] = []
    for vertices, persistence in detections:
        for vertex, height in zip(vertices.tolist(), persistence.tolist(), strict=True):
            gaps = [float(np.linalg.norm(V[vertex] - V[group[0][0]])) for group in members]
            if gaps and min(gaps) <= near:
                members[int(np.argmin(gaps))].append((vertex, height))
            else:
                members.append([(vertex, height)])
    return (
        np.array([_medoid(V, [vertex for vertex, _ in group]) for group in members], dtype=int),
        np.array([np.median([height for _, height in group]) for group in members]),
        np.array([len(group) / len(detections) for group in members]),
    )


def _medoid(V: FloatArray, vertices: list[int]) -> int:
    gaps = np.linalg.norm(V[vertices][:, None] - V[vertices][None], axis=2).sum(axis=1)
    return vertices[int(np.argmin(gaps))]


def _survivors(frame_anchors: FrameAnchors, anchors: IntArray, near: float) -> IntArray:
    """Keep the anchors that are detected again after smoothing; all if none is."""
    first = frame_anchors.animation[0]
    V = first.points
    smoothed = smooth(V, polygon_umbrella(first.topology), TRIAL_SMOOTHING_ITERATIONS)
    found = anchors_if_any(smoothed, first.faces, frame_anchors.proxies)
    again, _ = _vertices_and_persistence(found)
    if not again.size:
        return anchors
    gaps = np.linalg.norm(V[anchors][:, None] - V[again][None], axis=2).min(axis=1)
    return anchors[gaps <= near] if np.any(gaps <= near) else anchors
