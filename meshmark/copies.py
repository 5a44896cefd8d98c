"""Finds copies of a shape among arrays of numbers, whatever was done to them.

A copy may have been scaled, turned, sheared, shifted, rounded; its points may be in another
order, one for each corner of a face, or some of them missing. Rows whose vertices are known are
compared by a least-squares fit; others by aligning the two clouds and pairing nearest points.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# A copy lies this close to the shape, relative to its diagonal: marks are finer than that.
TOLERANCE = 1e-3
# What a sample, or one coordinate beside another, may differ more.
LOOSE = 3
# Pairs of nearest points must be this close, relative to the distance between neighbours.
PAIRING = 0.1
# Fewer points are the image of one another by some map all too easily.
MIN_POINTS = 32
# This part of the smaller of two clouds must be paired.
PAIRED = 0.5
SAMPLES = 64
CLOUD_SAMPLES = 400
# Alignments that are looked at closely, at most so many of one pose, and how far from the cloud,
# relative to its diagonal, the nearer third of the shape may be then.
ALIGNED = 16
OF_POSE = 4
NEAR = 0.05
ITERATIONS = 40
KEPT_POSES = 4
SCALES = (0.001, 0.01, 0.1, 1.0, 10.0, 100.0, 1000.0)


# The centre of a cloud (3,), and three axes (3, 3).
Frame = tuple[FloatArray, FloatArray]


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
        return _with_ones(points[self.vertices]) @ self.matrix


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
    if not shape.times or not np.isfinite(values).all():
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
    return _relative(off, matrix, shape.diagonals[:, None])


def _relative(off: FloatArray, matrix: FloatArray, diagonal: FloatArray | float) -> FloatArray:
    """Say of residuals of columns how large they are in the shape's own space."""
    gain = np.linalg.norm(matrix, axis=-2)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = off / (gain * diagonal)
    return np.where(np.isfinite(relative), relative, np.inf)


def _fitted(
    values: FloatArray, shape: Shape, index: int, vertices: IntArray, columns: IntArray
) -> Match | None:
    pose = shape.pose(index)
    matrix, off = _fit(pose.points[vertices], values[:, columns])
    error = _relative(off, matrix[:3], pose.diagonal)
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


def _fit(P: FloatArray, X: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Fit X (m, c) by an affine map of P (m, 3); the map (4, c), residuals of columns (c,)."""
    centre, middle = P.mean(axis=0), X.mean(axis=0)
    linear = np.linalg.lstsq(P - centre, X - middle, rcond=1e-9)[0]
    matrix = np.vstack([linear, middle - centre @ linear])
    off = np.sqrt(np.mean((X - _with_ones(P) @ matrix) ** 2, axis=0))
    return matrix, off


def _with_ones(points: FloatArray) -> FloatArray:
    return np.column_stack([points, np.ones(len(points))])


def find_cloud(
    cloud: FloatArray,
    shape: Shape,
    *,
    hint: float = np.nan,
    to_world: Callable[[float], FloatArray] | None = None,
) -> Match | None:
    """Find points that are an image of vertices of the shape, in any order, some of them missing.

    Parameters
    ----------
    cloud : (M, 3) float64
        Points.
    hint : float
        Time the cloud is given at.
    to_world : callable, optional
        Returns the matrix (4, 4) from the shape's own space to world space at a time.

    Returns
    -------
    Match or None
        Of all three columns.
    """
    if not shape.times or shape.n_points < MIN_POINTS or not np.isfinite(cloud).all():
        return None
    distinct = np.unique(cloud, axis=0)
    if len(distinct) < MIN_POINTS or _on_a_sphere(distinct):
        return None
    found: Match | None = None
    for index, matrix in _alignments(cloud, distinct, shape, hint, to_world):
        match = _paired(cloud, distinct, shape, index, matrix)
        if match is not None and (found is None or match.residual < found.residual):
            found = match
            if found.residual < 1e-6:
                break
    return found


def _on_a_sphere(cloud: FloatArray) -> bool:
    """Tell directions, such as normals, which resemble nothing but a ball."""
    radius = np.linalg.norm(cloud, axis=1)
    return bool(np.ptp(radius) < 0.02 * np.linalg.norm(np.ptp(cloud, axis=0)))


def _alignments(
    cloud: FloatArray,
    distinct: FloatArray,
    shape: Shape,
    hint: float,
    to_world: Callable[[float], FloatArray] | None,
) -> list[tuple[int, FloatArray]]:
    """Return the most promising poses and maps (4, 3) from the shape to the cloud, best first."""
    tree = cKDTree(distinct)
    size = np.linalg.norm(np.ptp(distinct, axis=0))
    cloud_frames = frames_of(distinct)
    scored: list[tuple[float, int, FloatArray]] = []

    def score(index: int, maps: Sequence[FloatArray]) -> None:
        image = _with_ones(shape.samples[index]) @ np.stack(maps)
        apart = tree.query(image.reshape(-1, 3))[0].reshape(len(maps), -1)
        # Of poses that are hardly different, the one at the same time is the likely one.
        favour = 0.5 if shape.times[index] == hint else 1.0
        ranks = favour * (np.quantile(apart, 0.3, axis=1) / size + 1e-9)
        scored.extend((float(rank), index, m) for rank, m in zip(ranks, maps, strict=True))

    for index, frames in enumerate(shape.frames):
        spaces = [np.eye(4, 3)]
        if to_world is not None:
            spaces.append(to_world(shape.times[index])[:, :3])
        maps = [space * scale for space in spaces for scale in SCALES]
        score(index, [*maps, *_by_frames(frames, cloud_frames)])
    if min(scored, key=_rank)[0] > TOLERANCE:
        for index in range(len(shape.times)):
            score(index, list(_by_order(shape.pose(index).points, cloud)))
    best: list[tuple[int, FloatArray]] = []
    of_pose: Counter[int] = Counter()
    for rank, index, matrix in sorted(scored, key=_rank):
        if rank >= NEAR or len(best) == ALIGNED:
            break
        if of_pose[index] < OF_POSE:
            of_pose[index] += 1
            best.append((index, matrix))
    return best


def _rank(scored: tuple[float, int, FloatArray]) -> float:
    return scored[0]


def _by_order(points: FloatArray, cloud: FloatArray) -> Iterator[FloatArray]:
    """Guess that points were left out at one end, or all but every second, third and so on."""
    m, n = len(cloud), len(points)
    run = min(m, n)
    guesses = [(points[:run], cloud[:run]), (points[-run:], cloud[-run:])]
    half = run // 2
    guesses += [(points[:half], cloud[:half]), (points[-half:], cloud[-half:])]
    guesses += [(points[::k], cloud) for k in (2, 3, 4, 5, 8, 10) if len(points[::k]) == m]
    for P, X in guesses:
        yield _fit(P, X)[0]


def frames_of(cloud: FloatArray) -> list[Frame]:
    """Return frames that go with a cloud: its centre (3,), and axes (3, 3) with their lengths.

    Those of its box, of its principal axes, and of its moments up to the fifth, which go with it
    through any affine map.
    """
    low, high = cloud.min(axis=0), cloud.max(axis=0)
    centre = cloud.mean(axis=0)
    X = cloud - centre
    values, axes = np.linalg.eigh(X.T @ X / len(X))
    size = np.sqrt(values.clip(min=1e-18 * max(values.max(), 1e-300)))
    Y = X @ axes / size
    square = np.sum(Y**2, axis=1, keepdims=True)
    first, second = np.mean(square * Y, axis=0), np.mean(square**2 * Y, axis=0)
    turn = np.linalg.qr(np.stack([first, second, np.cross(first, second)], axis=1))[0]
    turn *= np.where(np.sum(turn * np.stack([first, second, first], axis=1), axis=0) < 0, -1, 1)
    return [
        ((low + high) / 2, np.diag(high - low)),
        (centre, axes.T * np.sqrt((size**2).mean())),
        (centre, turn.T @ np.diag(size) @ axes.T),
    ]


def _by_frames(of_shape: Sequence[Frame], of_cloud: Sequence[Frame]) -> list[FloatArray]:
    """Map a shape to a cloud by their frames, with every sign of each axis."""
    signs = [np.array([x, y, z]) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
    maps = []
    for kind, ((c, A), (d, B)) in enumerate(zip(of_shape, of_cloud, strict=True)):
        for sign in signs[:1] if kind == 0 else signs:
            linear = np.linalg.pinv(A) @ (sign[:, None] * B)
            maps.append(np.vstack([linear, d - c @ linear]))
    return maps


def _paired(
    cloud: FloatArray, distinct: FloatArray, shape: Shape, index: int, matrix: FloatArray
) -> Match | None:
    """Pair points by a map, as it is or refined, if enough of them find a partner."""
    pose = shape.pose(index)
    back = _inverse(matrix)
    settled = _settled(distinct, pose, back)
    if settled is None:
        settled = _settled(distinct, pose, _refined(distinct, pose, back))
    if settled is None:
        return None
    apart, nearest = pose.tree.query(_with_ones(cloud) @ settled)
    rows = np.flatnonzero(apart <= pose.reach)
    matrix, off = _fit(pose.points[nearest[rows]], cloud[rows])
    error = _relative(off, matrix[:3], pose.diagonal)
    residual = float(np.sqrt(np.mean(error[np.isfinite(error)] ** 2)))
    return Match(
        shape.times[index],
        rows,
        np.arange(3),
        nearest[rows],
        matrix,
        residual,
        pose.diagonal,
    )


def _refined(distinct: FloatArray, pose: Pose, back: FloatArray) -> FloatArray:
    """Let a map from the cloud to the pose settle, by pairing a sample again and again."""
    X = distinct[np.random.default_rng(1).permutation(len(distinct))[:CLOUD_SAMPLES]]
    for step in range(ITERATIONS):
        apart, nearest = pose.tree.query(_with_ones(X) @ back)
        close = apart <= np.quantile(apart, 0.7)
        moved = _fit(X[close], pose.points[nearest[close]])[0]
        still = np.abs(moved - back).max() <= 1e-12 * np.abs(back).max()
        back = moved
        if still or (step == ITERATIONS // 4 and np.median(apart) > NEAR * pose.diagonal):
            break
    return back


def _settled(distinct: FloatArray, pose: Pose, back: FloatArray) -> FloatArray | None:
    """Fit a map to all pairs that are close, if these are enough."""
    for _ in range(3):
        apart, nearest = pose.tree.query(_with_ones(distinct) @ back)
        close = apart <= pose.reach
        if np.count_nonzero(close) < MIN_POINTS:
            return None
        back = _fit(distinct[close], pose.points[nearest[close]])[0]
    apart, nearest = pose.tree.query(_with_ones(distinct) @ back)
    n_paired = len(np.unique(nearest[apart <= pose.reach]))
    enough = max(MIN_POINTS, PAIRED * min(len(distinct), len(pose.points)))
    return back if n_paired >= enough else None


def _inverse(matrix: FloatArray) -> FloatArray:
    linear = np.linalg.pinv(matrix[:3], rcond=1e-9)
    return np.vstack([linear, -matrix[3] @ linear])
