"""Anchors that an animation keeps: found in nearly every frame, and again after rough treatment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.smoothing import polygon_umbrella, smooth
from meshmark.mesh.topology import Topology
from meshmark.workers.ordered_map import ordered_map
from meshmark_plugins.schemes.apex.anchors.detect import look
from meshmark_plugins.schemes.apex.anchors.integral_distance import distance_to_border

# Least persistence of an anchor that is marked, and of one that is looked at; in root areas.
LEAST_MARKED, LEAST_SEEN = 0.10, 0.06
MOST_SEEN = 12
FRAMES = 12
# Share of the frames in which an anchor must be found.
PRESENT = 0.9
# How near to each other, in root areas, two frame_anchors of one anchor are.
NEAR = 0.05
# A tip this near to a border would be one of the border's, which a crop moves.
CLEAR_OF_BORDER = 0.02
# Iterations of smoothing that an anchor must survive.
TRIAL = 10


class FrameAnchors:
    """The anchors seen in frames of an animation; no frame is looked at twice.

    Parameters
    ----------
    animation : MeshAnimation
        Frames as analysis sees them, of one topology.
    jobs : int
        Worker processes.
    """

    def __init__(self, animation: MeshAnimation, jobs: int) -> None:
        self.animation, self.jobs = animation, jobs
        self._seen: dict[int, tuple[IntArray, FloatArray]] = {}

    def of(self, frames: Sequence[int]) -> list[tuple[IntArray, FloatArray]]:
        """Return vertices and persistence of the anchors of some frames, maybe none."""
        new = [t for t in frames if t not in self._seen]
        found = ordered_map(FindAnchors(self.animation), new, jobs=self.jobs)
        self._seen.update(zip(new, found, strict=True))
        return [self._seen[t] for t in frames]


@dataclass(frozen=True, eq=False)
class FindAnchors:
    """Finds the anchors of frame after frame."""

    animation: MeshAnimation

    def __call__(self, index: int) -> tuple[IntArray, FloatArray]:
        """Return vertices and persistence of the anchors of frame `index`, maybe none."""
        frame = self.animation[index]
        return seen(frame.points, frame.faces)


def seen(V: FloatArray, F: IntArray) -> tuple[IntArray, FloatArray]:
    """Find the anchors of one mesh; none is no error here."""
    try:
        looks = look(V, F, LEAST_SEEN, MOST_SEEN)
    except CapacityError:
        return np.empty(0, dtype=np.int64), np.empty(0)
    vertices = np.concatenate([one.piece.vertices[one.maxima.vertices] for one in looks])
    return vertices, np.concatenate([one.maxima.persistence for one in looks])


def lasting_anchors(frame_anchors: FrameAnchors, most: int) -> IntArray:
    """Find the anchors worth marking.

    Parameters
    ----------
    frame_anchors : FrameAnchors
        Of the animation.
    most : int
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
    count = min(FRAMES, len(animation))
    chosen = np.unique(np.linspace(0, len(animation) - 1, count).round().astype(np.int64))
    first = animation[0]
    V, F = first.points, first.faces
    near = NEAR * float(np.sqrt(face_areas(V, F).sum()))
    vertices, persistence, share = _clusters(V, frame_anchors.of(chosen.tolist()), near)
    if not np.any(persistence >= LEAST_MARKED):
        raise CapacityError(
            "nothing sticks out of the mesh far enough to measure from; a mark needs tips such "
            "as hands, feet, ears or a tail: mark the mesh this one is worn by or stands on, or "
            "choose another scheme"
        )
    lasting = (persistence >= LEAST_MARKED) & (share >= PRESENT)
    clear = distance_to_border(V, F, vertices) >= near * CLEAR_OF_BORDER / NEAR
    if not np.any(lasting & clear):
        raise CapacityError(
            "the only tips lie on open borders, or are not there in every frame, so that none "
            "would be found again; choose another scheme"
        )
    kept = vertices[lasting & clear]
    order = np.argsort(-persistence[lasting & clear], kind="stable")
    return _survivors(first.topology, V, F, kept[order], near)[:most]


def anchors_in_poses(
    frame_anchors: FrameAnchors, anchors: IntArray, frames: Sequence[int]
) -> dict[int, IntArray]:
    """Find where anchors are seen in each of some poses.

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
        Vertices, by frame; the usual one where an anchor is not seen.
    """
    first = frame_anchors.animation[0]
    near = NEAR * float(np.sqrt(face_areas(first.points, first.faces).sum()))
    found = {}
    for t, (vertices, _) in zip(frames, frame_anchors.of(frames), strict=True):
        gaps = cdist(first.points[anchors], first.points[vertices])
        own, theirs = linear_sum_assignment(np.minimum(gaps, 2.0 * near))
        is_near = gaps[own, theirs] <= near
        found[t] = anchors.copy()
        found[t][own[is_near]] = vertices[theirs[is_near]]
    return found


def _clusters(
    V: FloatArray, frame_anchors: list[tuple[IntArray, FloatArray]], near: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Gather frame_anchors that lie near each other on one frame.

    Returns
    -------
    vertices : (m,) int
        The vertex of each cluster that the others are nearest to.
    persistence : (m,) float64
        Median over its frame_anchors.
    share : (m,) float64
        Share of the frames it was seen in.
    """
    members: list[list[tuple[int, float]]] = []
    for vertices, persistence in frame_anchors:
        for vertex, height in zip(vertices.tolist(), persistence.tolist(), strict=True):
            gaps = [float(np.linalg.norm(V[vertex] - V[group[0][0]])) for group in members]
            if gaps and min(gaps) <= near:
                members[int(np.argmin(gaps))].append((vertex, height))
            else:
                members.append([(vertex, height)])
    return (
        np.array([_medoid(V, [vertex for vertex, _ in group]) for group in members], dtype=int),
        np.array([np.median([height for _, height in group]) for group in members]),
        np.array([len(group) / len(frame_anchors) for group in members]),
    )


def _medoid(V: FloatArray, vertices: list[int]) -> int:
    gaps = np.linalg.norm(V[vertices][:, None] - V[vertices][None], axis=2).sum(axis=1)
    return vertices[int(np.argmin(gaps))]


def _survivors(
    topology: Topology, V: FloatArray, F: IntArray, anchors: IntArray, near: float
) -> IntArray:
    """Keep the anchors that are found again after smoothing; all if none is."""
    smoothed = smooth(V, polygon_umbrella(topology), TRIAL)
    again, _ = seen(smoothed, F)
    if not again.size:
        return anchors
    gaps = np.linalg.norm(V[anchors][:, None] - V[again][None], axis=2).min(axis=1)
    return anchors[gaps <= near] if np.any(gaps <= near) else anchors
