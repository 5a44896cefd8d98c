"""Finds copies of a shape among arrays of numbers, whatever was done to them.

A copy may have been scaled, turned, sheared, shifted, rounded; its points may be in another
order, one for each corner of a face, or some of them missing. Rows whose vertices are known are
compared by a least-squares fit, here; others, in `meshmark.delivery.clouds`, by aligning the two
clouds and pairing nearest points.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from meshmark.arrays import FloatArray, IntArray
from meshmark.delivery.affine import Frame, computable, fit, frames_of, relative, with_ones

# A copy lies this close to the shape, relative to its diagonal: marks are finer than that.
TOLERANCE = 1e-3
# What a sample, or one coordinate beside another, may differ more.
LOOSE = 3
# Pairs of nearest points must be this close, relative to the distance between neighbours.
PAIRING = 0.1
# Fewer points are the image of one another by some map all too easily.
MIN_POINTS = 32
SAMPLES = 64
KEPT_POSES = 4


@dataclass(frozen=True, eq=False)
class Match:
    """Rows of numbers that are the image of a shape's vertices by an affine map.

    Parameters
    ----------
    time : float
        When the shape is the one that was copied.
    rows, columns : (m,), (c,) int
        Which numbers.
    vertices : (m,) int
        Vertex of each row.
    matrix : (4, c) float64
        The map, for row vectors (x, y, z, 1).
    residual : float
        Root mean square of what the map leaves, over the diagonal, in the shape's own space.
    diagonal : float
        Of the shape's box at that time.
    """

    time: float
    rows: IntArray
    columns: IntArray
    vertices: IntArray
    matrix: FloatArray
    residual: float
    diagonal: float

    def image(self, points: FloatArray) -> FloatArray:
        """Map points (N, 3) of the shape, (m, c) float64."""
        return with_ones(points[self.vertices]) @ self.matrix


@dataclass(eq=False)
class Shape:
    """A mesh at all its times, of which copies are looked for.

    Holds a sample of vertices of each pose and its frames, not the poses.

    Parameters
    ----------
    n_points : int
        Number of vertices.
    corners : (C,) int
        Vertex of each corner of its faces.
    read : callable
        Returns the points (N, 3) float64 at a time.
    """

    n_points: int
    corners: IntArray
    read: Callable[[float], FloatArray]
    times: list[float] = field(default_factory=list, init=False)
    frames: list[list[Frame]] = field(default_factory=list, init=False)
    _samples: list[FloatArray] = field(default_factory=list, init=False)
    _diagonals: list[float] = field(default_factory=list, init=False)
    _poses: OrderedDict[float, Pose] = field(default_factory=OrderedDict, init=False)

    def add(self, time: float, points: FloatArray) -> None:
        """Take note of a pose.

        Raises
        ------
        ValueError
            If it has another number of vertices.
        """
        if len(points) != self.n_points:
            raise ValueError(f"{len(points)} points instead of {self.n_points}")
        self.times.append(time)
        self.frames.append(frames_of(np.asarray(points, dtype=np.float64)))
        self._samples.append(np.asarray(points, dtype=np.float64)[self.sampled])
        self._diagonals.append(float(np.linalg.norm(np.ptp(points, axis=0))))
        # Copies may have been looked for before, among the poses until then.
        for of_all_poses in ("samples", "diagonals"):
            vars(self).pop(of_all_poses, None)

    @cached_property
    def sampled(self) -> IntArray:
        """Vertices that are looked at first, (S,) int."""
        chosen = np.random.default_rng(0).permutation(self.n_points)[:SAMPLES]
        return np.sort(chosen)

    @cached_property
    def _corner_of_sampled(self) -> IntArray | None:
        """A corner at each sampled vertex, if every one has a face."""
        vertices, first = np.unique(self.corners, return_index=True)
        place = np.searchsorted(vertices, self.sampled).clip(max=max(len(vertices) - 1, 0))
        known = len(vertices) > 0 and np.array_equal(vertices[place], self.sampled)
        return first[place] if known else None

    @cached_property
    def samples(self) -> FloatArray:
        """Sampled vertices of every pose, (T, S, 3) float64."""
        return np.stack(self._samples)

    @cached_property
    def diagonals(self) -> FloatArray:
        """Diagonal of every pose, (T,) float64."""
        return np.array(self._diagonals)

    def pose(self, index: int) -> Pose:
        """Return a pose whole; a few are kept."""
        time = self.times[index]
        pose = self._poses.pop(time, None) or Pose(self.read(time), float(self.diagonals[index]))
        self._poses[time] = pose
        while len(self._poses) > KEPT_POSES:
            self._poses.popitem(last=False)
        return pose

    def layouts(self) -> Iterator[tuple[IntArray, IntArray]]:
        """Yield ways to list the vertices: the vertex of each row, and the rows of the samples."""
        yield np.arange(self.n_points), self.sampled
        if self._corner_of_sampled is not None and len(self.corners) != self.n_points:
            yield self.corners, self._corner_of_sampled


@dataclass(eq=False)
class Pose:
    """The points of a shape at one time, (N, 3) float64."""

    points: FloatArray
    diagonal: float

    @cached_property
    def tree(self) -> cKDTree:
        """For nearest points."""
        return cKDTree(self.points)

    @cached_property
    def reach(self) -> float:
        """How far apart two points may be to be called one."""
        apart = self.tree.query(self.points, k=2)[0][:, 1]
        apart = apart[apart > 0]
        spacing = float(np.median(apart)) if apart.size else 0.0
        return min(TOLERANCE * self.diagonal, PAIRING * spacing)


def find_in_order(
    values: FloatArray,
    shape: Shape,
    vertices: IntArray,
    sample_rows: IntArray,
    hint: float = np.nan,
) -> Iterator[Match]:
    """Find columns that are an image of the shape's vertices.

    Parameters
    ----------
    values : (R, c) float64
        Numbers, a row for each entry of `vertices`.
    vertices : (R,) int
        Vertex of each row.
    sample_rows : (S,) int
        A row for each sampled vertex of the shape.
    hint : float
        Time the numbers are given at.
    """
    if not shape.times or not computable(values):
        return
    spread = np.ptp(values, axis=0) > 1e-12 * np.abs(values).max(axis=0, initial=0)
    columns = np.flatnonzero(spread)
    if columns.size == 0:
        return
    if shape.n_points < MIN_POINTS:
        yield from _equal(values, shape, vertices)
        return
    error = _sample_errors(values[np.ix_(sample_rows, columns)], shape)
    # What belongs together was copied at one time.
    for group in np.split(columns, np.flatnonzero(np.diff(columns // 3)) + 1):
        of_group = error[:, np.searchsorted(columns, group)]
        within = of_group <= LOOSE * TOLERANCE
        if not within.any():
            continue
        total = np.where(within, of_group, 1.0).sum(axis=1)
        best = int(np.argmin(total))
        # Of poses that are hardly different, the one at the same time is the likely one.
        same = np.flatnonzero(np.array(shape.times) == hint)
        if same.size and total[same[0]] <= 2 * total[best] + 1e-6:
            best = int(same[0])
        match = _fitted(values, shape, best, vertices, group[within[best]])
        if match is not None:
            yield match


def _equal(values: FloatArray, shape: Shape, vertices: IntArray) -> Iterator[Match]:
    """Find the points as they are: any box is the image of any other."""
    if values.shape[1] < 3:
        return
    for index, time in enumerate(shape.times):
        pose = shape.pose(index)
        off = np.abs(values[:, :3] - pose.points[vertices]).max()
        if off <= 1e-6 * max(pose.diagonal, np.abs(pose.points).max()):
            rows, matrix = np.arange(len(values)), np.eye(4, 3)
            residual = float(off) / pose.diagonal if pose.diagonal else 0.0
            yield Match(time, rows, np.arange(3), vertices, matrix, residual, pose.diagonal)
            return


def _sample_errors(values: FloatArray, shape: Shape) -> FloatArray:
    """Fit columns (S, c) to every pose's sample; residuals over the diagonal, (T, c)."""
    centred = values - values.mean(axis=0)
    scaled = centred / np.abs(centred).max(axis=0, initial=1e-300)
    S = shape.samples - shape.samples.mean(axis=1, keepdims=True)
    matrix = np.linalg.pinv(S, rcond=1e-9) @ scaled
    off = np.sqrt(np.mean((scaled - S @ matrix) ** 2, axis=1))
    return relative(off, matrix, shape.diagonals[:, None])


def _fitted(
    values: FloatArray, shape: Shape, index: int, vertices: IntArray, columns: IntArray
) -> Match | None:
    pose = shape.pose(index)
    matrix, off = fit(pose.points[vertices], values[:, columns])
    error = relative(off, matrix[:3], pose.diagonal)
    if error.min() > TOLERANCE:
        return None
    fits = error <= LOOSE * TOLERANCE
    return Match(
        shape.times[index],
        np.arange(len(values)),
        columns[fits],
        vertices,
        matrix[:, fits],
        float(np.sqrt(np.mean(error[fits] ** 2))),
        pose.diagonal,
    )
