"""Finds copies of a shape among clouds of points, in any order, some of them missing."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from scipy.spatial import cKDTree

from meshmark.arrays import FloatArray
from meshmark.delivery.affine import Frame, computable, fit, frames_of, inverse, relative, with_ones
from meshmark.delivery.copies import MIN_POINTS, TOLERANCE, Match, Pose, Shape

# This part of the smaller of two clouds must be paired.
PAIRED = 0.5
CLOUD_SAMPLES = 400
# Alignments that are looked at closely, at most so many of one pose, and how far from the cloud,
# relative to its diagonal, the nearer third of the shape may be then.
ALIGNED = 16
OF_POSE = 4
NEAR = 0.05
ITERATIONS = 40
SCALES = (0.001, 0.01, 0.1, 1.0, 10.0, 100.0, 1000.0)
# Below it, squares underflow.
NO_SIZE = 1e-150


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
    if not shape.times or shape.n_points < MIN_POINTS or not computable(cloud):
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
    size = np.linalg.norm(np.ptp(distinct, axis=0))
    if size < NO_SIZE:
        return []
    tree = cKDTree(distinct)
    cloud_frames = frames_of(distinct)
    scored: list[tuple[float, int, FloatArray]] = []

    def score(index: int, maps: Sequence[FloatArray]) -> None:
        image = with_ones(shape.samples[index]) @ np.stack(maps)
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
        yield fit(P, X)[0]


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
    back = inverse(matrix)
    settled = _settled(distinct, pose, back)
    if settled is None:
        settled = _settled(distinct, pose, _refined(distinct, pose, back))
    if settled is None:
        return None
    apart, nearest = pose.tree.query(with_ones(cloud) @ settled)
    rows = np.flatnonzero(apart <= pose.reach)
    matrix, off = fit(pose.points[nearest[rows]], cloud[rows])
    error = relative(off, matrix[:3], pose.diagonal)
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
        apart, nearest = pose.tree.query(with_ones(X) @ back)
        close = apart <= np.quantile(apart, 0.7)
        moved = fit(X[close], pose.points[nearest[close]])[0]
        still = np.abs(moved - back).max() <= 1e-12 * np.abs(back).max()
        back = moved
        if still or (step == ITERATIONS // 4 and np.median(apart) > NEAR * pose.diagonal):
            break
    return back


def _settled(distinct: FloatArray, pose: Pose, back: FloatArray) -> FloatArray | None:
    """Fit a map to all pairs that are close, if these are enough."""
    for _ in range(3):
        apart, nearest = pose.tree.query(with_ones(distinct) @ back)
        close = apart <= pose.reach
        if np.count_nonzero(close) < MIN_POINTS:
            return None
        back = fit(distinct[close], pose.points[nearest[close]])[0]
    apart, nearest = pose.tree.query(with_ones(distinct) @ back)
    n_paired = len(np.unique(nearest[apart <= pose.reach]))
    enough = max(MIN_POINTS, PAIRED * min(len(distinct), len(pose.points)))
    return back if n_paired >= enough else None
