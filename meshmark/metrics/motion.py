"""How a mark behaves over time: whether it rests on the moving surface or trembles on it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.deformation import Deformation, OneRings

# Vertices that flicker is measured at, at most: evenly spread over their list.
MOST_VERTICES = 2_500


def flicker(P: FloatArray, D: FloatArray, F: IntArray) -> float:
    """Measure how restless displacements are on the surface that carries them.

    Parameters
    ----------
    P : (T, N, 3) float64
        Original positions in consecutive frames.
    D : (T, N, 3) float64
        Displacement of each vertex.
    F : (F, 3) int
        Triangles.

    Returns
    -------
    float
        RMS of D[t + 1] - G D[t] over the RMS of D, over all frames and up to `MOST_VERTICES`
        vertices, where G is the gradient of the originals' `Deformation` from t to t + 1: 0 for a
        displacement that turns and stretches with the surface, 2 for one that alternates in sign
        on it; on a surface at rest sqrt(2) for one that is new in every frame. 0 too without
        displacement or with a single frame.
    """
    total = Flicker()
    for positions, displacement in zip(P, D, strict=True):
        total.add(positions, displacement, F)
    return total.ratio()


def flicker_world(D: FloatArray) -> float:
    """Measure how restless displacements are in space, whatever their surface does.

    Parameters
    ----------
    D : (T, N, 3) float64
        Displacement of each vertex in consecutive frames.

    Returns
    -------
    float
        RMS of D[t + 1] - D[t] over the RMS of D, over all vertices and frames. One that rests on
        a surface which turns by an angle about an axis across it shows 2 sin(angle / 2).
    """
    if len(D) < 2 or not D.any():
        return 0.0
    return math.sqrt(_mean_square(np.diff(D, axis=0)) / _mean_square(D))


def jitter(P: FloatArray, D: FloatArray, times: FloatArray | None = None) -> float:
    """Measure how much more a mark trembles than the motion itself does.

    Parameters
    ----------
    P : (T, N, 3) float64
        Original positions.
    D : (T, N, 3) float64
        Displacement of each vertex.
    times : (T,) float64, optional
        Time of each frame, increasing; evenly spaced by default.

    Returns
    -------
    float
        RMS acceleration of the displacement over the RMS acceleration of the motion, over all
        vertices and all frames with a neighbour on either side. NaN with fewer than three
        frames; 0 for a displacement without acceleration; inf if only the motion has none.

    Notes
    -----
    Acceleration is the second divided difference over time. STED [1]_, which is fitted to what
    people see, weighs relative changes of edges over space and time by their neighbourhoods;
    this is a plain ratio, free of fitted constants, for the temporal half of that question.

    References
    ----------
    .. [1] L. Váša, V. Skala, "A Perception Correlated Comparison Method for Dynamic Meshes",
       IEEE Transactions on Visualization and Computer Graphics 17(2), 220-230, 2011.
    """
    total = Jitter()
    clock = np.arange(float(len(P))) if times is None else times
    for time, positions, displacement in zip(clock, P, D, strict=True):
        total.add(float(time), positions, displacement)
    return total.ratio()


class Flicker:
    """Sums for `flicker` and `flicker_world`, one frame at a time; one is held."""

    def __init__(self) -> None:
        self._last: _Held | None = None
        self._size = self._change = self._change_world = 0.0
        self._frames = self._pairs = 0

    def add(self, P: FloatArray, D: FloatArray, F: IntArray) -> None:
        """Take in original positions and displacement (N, 3), and triangles, of the next frame.

        A frame whose triangles are not those of the frame before is compared with the next only.
        """
        last = self._last
        if last is None or not last.has_faces(F, len(P)):
            at = np.unique(np.linspace(0, len(P) - 1, MOST_VERTICES).round().astype(np.int64))
            self._last = _Held(P, D[at], F, at, OneRings(F, len(P), at))
        else:
            self._last = replace(last, P=P, D=D[last.at])
            carried = Deformation(last.P, F, last.rings).carry(last.D, P)
            self._change += _mean_square(self._last.D - carried)
            self._change_world += _mean_square(self._last.D - last.D)
            self._pairs += 1
        self._size += _mean_square(self._last.D)
        self._frames += 1

    def ratio(self) -> float:
        """Return the RMS change on the surface over the RMS size so far."""
        return self._over_size(self._change)

    def ratio_world(self) -> float:
        """Return the RMS change in space over the RMS size so far."""
        return self._over_size(self._change_world)

    def _over_size(self, change: float) -> float:
        if self._pairs == 0 or self._size == 0.0:
            return 0.0
        return math.sqrt((change / self._pairs) / (self._size / self._frames))


@dataclass(frozen=True, eq=False)
class _Held:
    """A frame: positions, triangles, and displacements of the vertices that are looked at."""

    P: FloatArray
    D: FloatArray
    F: IntArray
    at: IntArray
    rings: OneRings

    def has_faces(self, F: IntArray, n_points: int) -> bool:
        """Tell whether its triangles are these."""
        return len(self.P) == n_points and (self.F is F or np.array_equal(self.F, F))


class Jitter:
    """Sums for `jitter`, one frame at a time; three are held."""

    def __init__(self) -> None:
        self._held: list[tuple[float, FloatArray, FloatArray]] = []
        self._mark = self._motion = 0.0
        self._frames = 0

    def add(self, time: float, P: FloatArray, D: FloatArray) -> None:
        """Take in time, original positions and displacement (N, 3) of the next frame."""
        self._held = [*self._held[-2:], (time, P, D)]
        if len(self._held) < 3 or len({len(frame[1]) for frame in self._held}) > 1:
            return
        times, positions, displacements = zip(*self._held, strict=True)
        self._motion += _mean_square_acceleration(times, positions)
        self._mark += _mean_square_acceleration(times, displacements)
        self._frames += 1

    def ratio(self) -> float:
        """Return the RMS acceleration of the mark over that of the motion so far."""
        if self._frames == 0:
            return math.nan
        if self._mark == 0.0:
            return 0.0
        return math.sqrt(self._mark / self._motion) if self._motion > 0.0 else math.inf


def _mean_square_acceleration(times: tuple[float, ...], X: tuple[FloatArray, ...]) -> float:
    before, after = times[1] - times[0], times[2] - times[1]
    a = ((X[2] - X[1]) / after - (X[1] - X[0]) / before) / ((before + after) / 2.0)
    return _mean_square(a)


def _mean_square(X: FloatArray) -> float:
    """Average the squared length of vectors (..., 3)."""
    return float(np.sum(X * X)) * X.shape[-1] / X.size
