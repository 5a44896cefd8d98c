"""What programs do to a surface: found out from a copy, without any key."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.sparse import csr_matrix, eye_array

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame
from meshmark.mesh.smoothing import polygon_umbrella, smooth
from meshmark.mesh.subdivision import subdivide
from meshmark.mesh.topology import Topology

# Taubin's second step goes back by mu, 1 / step + 1 / mu = this pass band.
PASS_BAND = 0.1
# Finer references than this many points are not made.
MOST_POINTS = 50_000


@dataclass(frozen=True)
class Treatment:
    """Subdivision, or steps of smoothing, that a copy may have been through.

    Parameters
    ----------
    rule : str
        That of subdivision; see `meshmark.mesh.subdivision.RULES`.
    levels : int
        How often it was applied.
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

    rule: str = ""
    levels: int = 0
    step: float = 0.1
    count: int = 0
    taubin: bool = False

    def surface(self, frame: Frame) -> tuple[csr_matrix, Frame]:
        """Take a frame through it.

        Returns
        -------
        weights : (M, N) sparse
            How much of each of its vertices each new vertex is.
        frame : Frame
            M vertices.
        """
        W, topology = _finer(frame.topology, self.rule, self.levels)
        finer = Frame(frame.time, W @ frame.points, topology)
        return W, finer.moved(self._smoothed(finer))

    def _smoothed(self, frame: Frame) -> FloatArray:
        V, L = frame.points, polygon_umbrella(frame.topology)
        if not self.taubin:
            return smooth(V, L, self.count, self.step)
        back = 1.0 / (PASS_BAND - 1.0 / self.step)
        for _ in range(self.count):
            V = smooth(smooth(V, L, 1, self.step), L, 1, back)
        return V


@lru_cache(maxsize=4)
def _finer(topology: Topology, rule: str, levels: int) -> tuple[csr_matrix, Topology]:
    """Subdivide; remembered for the topologies used last."""
    if levels == 0:
        return csr_matrix(eye_array(topology.n_points)), topology
    return subdivide(topology, rule, levels)


NONE = Treatment()
# Every kind, from few steps to many. Between two of them the one nearer to the copy is tried next.
KINDS = (
    tuple(Treatment(step=0.1, count=n) for n in (1, 3, 10, 30, 50, 100, 200, 300)),
    tuple(Treatment(step=0.5, count=n) for n in (1, 3, 10, 30)),
    (Treatment(step=1.0, count=1),),
    tuple(Treatment(step=0.5, count=n, taubin=True) for n in (2, 10, 30, 50, 100)),
    tuple(Treatment(step=0.33, count=n, taubin=True) for n in (10, 50)),
)


def subdivisions(n_points: int, n_copy: int) -> list[Treatment]:
    """List the subdivisions that may have made so many vertices of a reference's."""
    return [
        Treatment(rule, levels)
        for rule in ("loop", "catmull_clark")
        for levels in (1, 2, 3)
        if n_copy > 1.5 * n_points and n_points * 4**levels <= MOST_POINTS
    ]


def between(one: Treatment, two: Treatment) -> list[Treatment]:
    """List some treatments of the same kind between two."""
    counts = np.geomspace(one.count, two.count, 6).round().astype(int)
    return [
        Treatment(step=one.step, count=int(n), taubin=one.taubin)
        for n in np.unique(counts)
        if n not in (one.count, two.count)
    ]
