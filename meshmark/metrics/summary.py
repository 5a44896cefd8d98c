"""All measures of an animation's distortion in one, frame by frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import UsageError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import surface_box, vertex_normals
from meshmark.metrics.faces import flipped_faces, max_move_edges, min_angle_change, normal_turn
from meshmark.metrics.motion import Flicker, Jitter
from meshmark.metrics.surface_distance import surface_distance
from meshmark.metrics.texture import Coordinates, Texture
from meshmark.workers.ordered_map import ordered_map


@dataclass(frozen=True)
class Distortion:
    """Distortion of an animation: means over the frames compared; flicker and jitter span all.

    Parameters
    ----------
    hausdorff, mrms : float
        Surface distances in the unit of the points. `mrms` is carried from the frames compared to
        all, see `ratio_to_all`.
    hausdorff_rel, mrms_rel : float
        The same over the diagonal of the original frame's bounding box.
    mrms_rel_error : float
        Standard error of `mrms_rel`; NaN for one frame of several.
    compared_frames : int
        Frames compared.
    flipped_faces : float
        Faces whose normal turned by more than 90 degrees.
    min_angle_change : float
        Largest loss of a face's smallest angle, in degrees.
    normal_turn : float
        Root mean square over the area by which normals turned, in degrees.
    max_move_edges : float
        Largest move of a vertex in mean edge lengths.
    texture_drift : float
        Farthest slide of a vertex under its texture coordinates, in texels of a 4k map; NaN
        without texture coordinates.
    flicker : float
        Change of the displacement between neighbouring frames over the displacement, once the
        moving surface has carried it along.
    flicker_world : float
        The same in space: it counts the turning of the surface too.
    jitter : float
        Acceleration of the displacement over that of the motion; NaN with fewer than three
        frames, inf without motion.

    Notes
    -----
    All but the surface distances are NaN where the two animations do not share their vertices
    and faces.
    """

    hausdorff: float
    mrms: float
    hausdorff_rel: float
    mrms_rel: float
    mrms_rel_error: float
    compared_frames: int
    flipped_faces: float
    min_angle_change: float
    normal_turn: float
    max_move_edges: float
    texture_drift: float
    flicker: float
    flicker_world: float
    jitter: float


def distortion(
    original: MeshAnimation,
    marked: MeshAnimation,
    frames: Sequence[int] | None = None,
    *,
    uv: FloatArray | Coordinates | None = None,
    marked_uv: Coordinates | None = None,
    samples: int | None = None,
    seed: int = 0,
    jobs: int = 1,
) -> Distortion:
    """Measure the distortion of an animation, reading one pair of frames at a time.

    Parameters
    ----------
    original, marked : MeshAnimation
        As many frames each; compared in order.
    frames : sequence of int, optional
        Indices of the frames to compare, increasing; all by default. Flicker and jitter are
        those of all frames in any case.
    uv : (N, 2) or (F, 3, 2) float64, or callable, optional
        Texture coordinates of the vertices or of the triangles' corners, in every frame; or what
        returns them for a time.
    marked_uv : callable, optional
        Returns those of the marked animation for a time, where they are others.
    samples, seed
        As in `surface_distance`.
    jobs : int
        Processes that work, this one among them.

    Raises
    ------
    UsageError
        If the animations have different numbers of frames, or no frame is asked for.
    """
    if len(original) != len(marked):
        raise UsageError(
            f"{len(marked)} frames cannot be compared with {len(original)}",
            source=original.origin or None,
            prim=original.prim,
        )
    chosen = range(len(original)) if frames is None else frames
    if not len(chosen):
        raise UsageError("there is no frame to compare", prim=original.prim)
    compare = _CompareFrames(original, marked, Texture(uv, marked_uv), samples, seed)
    rows: list[dict[str, float]] = []
    over_time = _OverTime(original, marked)
    # What needs the frames in order is done here, while workers compare those ahead.
    for index, row in zip(chosen, ordered_map(compare, chosen, jobs=jobs, light=True), strict=True):
        rows.append(row)
        over_time.add_until(index + 1)
    over_time.add_until(len(original))
    errors = np.array([row.pop("mrms_rel_error") for row in rows])
    means = dict(zip(rows[0], np.mean([list(row.values()) for row in rows], axis=0), strict=True))
    shared = not math.isnan(means["max_move_edges"])
    mrms = np.array([row["mrms_rel"] for row in rows])
    ratio, error = ratio_to_all(mrms, errors, np.array(over_time.heights), list(chosen))
    means["mrms"], means["mrms_rel"] = ratio * means["mrms"], ratio * means["mrms_rel"]
    return Distortion(
        **{name: float(mean) for name, mean in means.items()},
        mrms_rel_error=error,
        compared_frames=len(rows),
        flicker=over_time.flicker.ratio() if shared else math.nan,
        flicker_world=over_time.flicker.ratio_world() if shared else math.nan,
        jitter=over_time.jitter.ratio() if shared else math.nan,
    )


def standard_error(values: FloatArray, errors: FloatArray, n_frames: int) -> float:
    """Compute the standard error of a mean over frames of which only some were measured.

    Parameters
    ----------
    values : (n,) float64
        What was measured of each frame.
    errors : (n,) float64
        Standard error of each.
    n_frames : int
        Frames in all.

    Returns
    -------
    float
        As if the frames were drawn at random without replacement: frames that are spread over a
        motion err by less. NaN for one of several frames.
    """
    n = len(values)
    within = float(np.sum(errors**2)) / n**2
    if n == n_frames:
        return math.sqrt(within)
    if n == 1:
        return math.nan
    return math.sqrt(within + (1.0 - n / n_frames) * float(np.var(values, ddof=1)) / n)


def ratio_to_all(
    values: FloatArray, errors: FloatArray, hints: FloatArray, measured: Sequence[int]
) -> tuple[float, float]:
    """Compute what the mean over some frames is to be multiplied by to be that over all.

    Parameters
    ----------
    values : (n,) float64
        What was measured of some frames.
    errors : (n,) float64
        Standard error of each.
    hints : (T,) float64
        What is about proportional to it, of all frames; NaN where it is not known.
    measured : sequence of int
        Indices of the n frames.

    Returns
    -------
    ratio : float
    error : float
        Standard error of the product; see `standard_error`.

    Notes
    -----
    The mean of the hints over all frames over their mean over the frames measured: the ratio
    estimate [1]_. Only what the hints do not tell of the frames is left to chance. It is 1 where
    hints are not known, or there are none but 0.

    References
    ----------
    .. [1] W. G. Cochran, "Sampling techniques", 3rd edition, 1977, chapter 6.
    """
    known = hints[list(measured)]
    if np.isnan(hints).any() or not known.any():
        return 1.0, standard_error(values, errors, len(hints))
    ratio = float(hints.mean() / known.mean())
    left = values - known * values.mean() / known.mean()
    return ratio, ratio * standard_error(left, errors, len(hints))


class _OverTime:
    """What needs the frames in order, read once.

    Attributes
    ----------
    heights : list of float
        Root mean square by which each frame's vertices left their surface, along its normals, over
        its diagonal; NaN without one, and where the frames do not share their vertices and faces.
    """

    def __init__(self, original: MeshAnimation, marked: MeshAnimation) -> None:
        self._original, self._marked, self._next = original, marked, 0
        self.flicker, self.jitter = Flicker(), Jitter()
        self.heights: list[float] = []

    def add_until(self, stop: int) -> None:
        """Take in the frames before `stop` that were not yet."""
        for index in range(self._next, stop):
            before, after = self._original[index], self._marked[index]
            self.heights.append(math.nan)
            if before.topology.same_as(after.topology):
                displacement = after.points - before.points
                self.heights[-1] = _height(before, displacement)
                self.flicker.add(before.points, displacement, before.faces)
                self.jitter.add(before.time, before.points, displacement)
        self._next = stop


def _height(frame: Frame, displacement: FloatArray) -> float:
    normals = vertex_normals(frame.points, frame.faces)
    height = np.einsum("ij,ij->i", displacement, normals)
    diagonal = surface_box(frame.points, frame.faces)[0]
    return float(np.sqrt(np.mean(height**2))) / (diagonal or math.nan)


@dataclass(frozen=True, eq=False)
class _CompareFrames:
    """Compares frame after frame of two animations; picklable, for worker processes."""

    original: MeshAnimation
    marked: MeshAnimation
    texture: Texture
    samples: int | None
    seed: int

    def __call__(self, index: int) -> dict[str, float]:
        pair = self.original[index], self.marked[index]
        return _frame_distortion(*pair, self.texture, self.samples, self.seed)


def _frame_distortion(
    before: Frame, after: Frame, texture: Texture, samples: int | None, seed: int
) -> dict[str, float]:
    distance = surface_distance(
        before.points, before.faces, after.points, after.faces, samples=samples, seed=seed
    )
    row = {
        "hausdorff": distance.hausdorff,
        "mrms": distance.mrms,
        "hausdorff_rel": distance.hausdorff / distance.diagonal,
        "mrms_rel": distance.mrms / distance.diagonal,
        "mrms_rel_error": distance.mrms_error / distance.diagonal,
    }
    pair = (before.points, after.points, before.faces)
    if not before.topology.same_as(after.topology):
        unknown = (
            *("flipped_faces", "min_angle_change", "normal_turn"),
            *("max_move_edges", "texture_drift"),
        )
        return {**row, **dict.fromkeys(unknown, math.nan)}
    return {
        **row,
        "flipped_faces": float(flipped_faces(*pair)),
        "min_angle_change": min_angle_change(*pair),
        "normal_turn": normal_turn(*pair),
        "max_move_edges": max_move_edges(*pair),
        "texture_drift": texture.largest_drift(before.time, *pair),
    }
