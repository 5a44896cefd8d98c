"""What programs do to a surface to smooth it: found out from a copy, without any key."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame
from meshmark.mesh.smoothing import polygon_umbrella, smooth

# Taubin's second step goes back by mu, 1 / step + 1 / mu = this pass band.
PASS_BAND = 0.1


@dataclass(frozen=True)
class Treatment:
    """Steps of smoothing that a copy may have been through.

    Parameters
    ----------
    step : float
        Share of the way to the mean of its neighbours that a vertex takes in one step.
    count : int
        How many steps.
    taubin : bool
        Whether each is followed by a longer step back, which keeps the volume.

    References
    ----------
    G. Taubin, "A signal processing approach to fair surface design", SIGGRAPH 1995.
    doi:10.1145/218380.218473
    """

    step: float = 0.1
    count: int = 0
    taubin: bool = False

    def points(self, frame: Frame) -> FloatArray:
        """Take the points of a frame through it."""
        V, L = frame.points, polygon_umbrella(frame.topology)
        if not self.taubin:
            return smooth(V, L, self.count, self.step)
        back = 1.0 / (PASS_BAND - 1.0 / self.step)
        for _ in range(self.count):
            V = smooth(smooth(V, L, 1, self.step), L, 1, back)
        return V


NONE = Treatment()
# Every kind, from few steps to many. Between two of them the one nearer to the copy is tried next.
KINDS = (
    tuple(Treatment(0.1, n) for n in (1, 3, 10, 30, 50, 100, 200, 300)),
    tuple(Treatment(0.5, n) for n in (1, 3, 10, 30)),
    (Treatment(1.0, 1),),
    tuple(Treatment(0.5, n, taubin=True) for n in (2, 10, 30, 50, 100)),
    tuple(Treatment(0.33, n, taubin=True) for n in (10, 50)),
)


def between(one: Treatment, two: Treatment) -> list[Treatment]:
    """List some treatments of the same kind between two."""
    counts = np.geomspace(one.count, two.count, 6).round().astype(int)
    return [
        Treatment(one.step, int(n), one.taubin)
        for n in np.unique(counts)
        if n not in (one.count, two.count)
    ]
