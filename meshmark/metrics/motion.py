"""How a mark behaves over time: whether it rests on the moving surface or trembles on it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def flicker(D: FloatArray) -> float:
    """Measure how restless displacements are over time.

    Parameters
    ----------
    D : (T, N, 3) float64
        Displacement of each vertex in consecutive frames.

    Returns
    -------
    float
        RMS of D[t + 1] - D[t] over the RMS of D, over all vertices and frames: 0 for a
        displacement that stays, sqrt(2) for one that is new in every frame, 2 for one that
        alternates in sign; 0 too without displacement or with a single frame.
    """
    total = Flicker()
    for displacement in D:
        total.add(displacement)
    return total.ratio()


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
    """Sums for `flicker`, one frame at a time."""

    def __init__(self) -> None:
        self._last: FloatArray | None = None
        self._size = self._change = 0.0
        self._frames = 0

    def add(self, D: FloatArray) -> None:
        """Take in the displacement of the next frame, (N, 3)."""
        self._size += float(np.mean(np.sum(D**2, axis=1)))
        if self._last is not None and len(self._last) == len(D):
            self._change += float(np.mean(np.sum((D - self._last) ** 2, axis=1)))
        self._last = D
        self._frames += 1

    def ratio(self) -> float:
        """Return the RMS change over the RMS size so far."""
        if self._frames < 2 or self._size == 0.0:
            return 0.0
        return math.sqrt((self._change / (self._frames - 1)) / (self._size / self._frames))


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
    return float(np.mean(np.sum(a**2, axis=1)))
