"""How far points of a copy lie from its original, once both are laid upon each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.placement import FramePlacement, MeshAlignment
from meshmark.alignment.poses import posed
from meshmark.alignment.reposing import reposed
from meshmark.alignment.search import REPOSED
from meshmark.arrays import FloatArray
from meshmark.mesh.closest_points import ClosestPoints
from meshmark.mesh.geometry import surface_box

LABEL = "Distance from the original"


class Distances:
    """Measures points of a copy against every mesh of the original that was found in it.

    Parameters
    ----------
    found : sequence of MeshAlignment
        At least one.
    """

    def __init__(self, found: Sequence[MeshAlignment]) -> None:
        self._meshes = [_Placed(each) for each in found]

    def times(self, shown: FloatArray) -> list[float]:
        """Return the times at which that mesh was placed that most often was at times shown."""
        lead = max(
            self._meshes, key=lambda each: (np.isin(each.times, shown).sum(), len(each.times))
        )
        return lead.times

    def __call__(self, P: FloatArray, time: float) -> FloatArray:
        """Measure points (n, 3) at a time, (n,): shares of the original's diagonal.

        Of several meshes of the original, the nearest counts; of the runs of one whose
        connectivity changes, that which the copy shows then.
        """
        then = [placed for placed in self._meshes if placed.lasts(time)] or self._meshes
        surfaces = [placed.surface(time) for placed in then]
        return np.min([surface(P) for surface in surfaces], axis=0)


class _Placed:
    """One mesh of the original, where frames of the copy show it."""

    def __init__(self, found: MeshAlignment) -> None:
        self._found = found
        self.times = [float(found.copy[0].times[frame.index]) for frame in found.frames]
        first = found.original[0]
        self._diagonal, _ = surface_box(first.points, first.faces)

    def lasts(self, time: float) -> bool:
        """Tell whether the copy of it has begun at a time, and not ended."""
        times = self._found.copy[0].times
        return not times[0] > time and not times[-1] < time

    def surface(self, time: float) -> Callable[[FloatArray], FloatArray]:
        """Return what measures points of the copy at the placed frame that is nearest in time."""
        gaps = np.abs(np.nan_to_num(self.times) - np.nan_to_num(time))
        placement = self._found.frames[int(gaps.argmin())]
        frame = posed(self._found.original, placement.pose)
        V = frame.points
        if self._found.method == REPOSED:
            V = self._bent(V, placement)
        surface, onto = ClosestPoints(V, frame.faces), placement.maps["similarity"]
        return lambda P: surface.distances(onto(P)) / self._diagonal

    def _bent(self, V: FloatArray, placement: FramePlacement) -> FloatArray:
        """Bend the original to a pose that it never takes, as the copy shows it."""
        copy = CopyFrame.of(self._found.copy, placement.index)
        Q = V.copy()
        Q[copy.vertices] = placement.maps["similarity"](copy.points)
        return reposed(V, Q, self._found.original[0].topology)
