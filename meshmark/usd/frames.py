"""The frames of one mesh prim, read from its stage when asked for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from pxr import Usd

from meshmark.animation import Frame, Topology
from meshmark.errors import InputError, MeshmarkError
from meshmark.usd.diagnostics import caught
from meshmark.usd.geometry import local_points, local_to_world, read_topology, world_points
from meshmark.usd.opening import OpenStage, open_stage


@dataclass(frozen=True)
class StageFrames:
    """Frames of a mesh prim in world space.

    Holds only where to read: it pickles to a few bytes, and every process opens the stage for
    itself. Frames of constant topology share one `Topology` in each process.

    Parameters
    ----------
    source : str
        The stage's file.
    prim : str
        Path of the mesh.
    times : tuple of float
        Time codes; a single NaN if the points have no time samples.
    varies : bool
        Whether the faces change over time.
    """

    source: str
    prim: str
    times: tuple[float, ...]
    varies: bool = False

    def frame(self, index: int) -> Frame:
        """Read frame `index`.

        Raises
        ------
        InputError
            If the mesh is unfit at that time: no points, points that are not finite, or
            points and faces that do not fit each other.
        """
        opened = open_stage(self.source)
        time = self.times[index]
        with blamed(self.source, self.prim, time):
            prim = opened.stage.GetPrimAtPath(self.prim)
            points = world_points(local_points(prim, time), local_to_world(prim, time))
            return Frame(time, points, self._topology(opened, prim, time, len(points)))

    def _topology(self, opened: OpenStage, prim: Usd.Prim, time: float, n_points: int) -> Topology:
        if self.varies:
            return read_topology(prim, time, n_points)
        known = opened.topologies.get(self.prim)
        if known is None:
            known = read_topology(prim, self.times[0], n_points)
            opened.topologies[self.prim] = known
        if known.n_points != n_points:
            raise InputError(
                f"{n_points} points here but {known.n_points} at another time, "
                "while the faces stay the same"
            )
        return known


@contextmanager
def blamed(source: str, prim: str, time: float | None = None) -> Iterator[None]:
    """Add to errors that do not say it which file, prim and frame they are about."""
    try:
        with caught(source, prim=prim, time=time):
            yield
    except MeshmarkError as error:
        if error.prim is not None:
            raise
        raise type(error)(error.message, source=source, prim=prim, time=time) from None
