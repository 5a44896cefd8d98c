"""The frames of one mesh prim, read from its stage when asked for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from pxr import Usd

from meshmark.errors import InputError, MeshmarkError
from meshmark.mesh.animation import Frame
from meshmark.mesh.skinning import Skinning
from meshmark.mesh.topology import Topology
from meshmark.usd.diagnostics import caught
from meshmark.usd.geometry import number_of_points, read_topology
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
        Time codes; a single NaN if nothing that moves the points has time samples.
    reference : int or None
        A frame whose faces, and number of points, are those of all; None if they change.
    strays : tuple of int
        Frames of which that is not true, and which are therefore not to be had.
    variants : tuple of str
        The variants to select; see `open_stage`.
    """

    source: str
    prim: str
    times: tuple[float, ...]
    reference: int | None = 0
    strays: tuple[int, ...] = ()
    variants: tuple[str, ...] = ()

    def frame(self, index: int) -> Frame:
        """Read frame `index`.

        Raises
        ------
        InputError
            If the mesh is unfit at that time: no points, points that are not finite, points
            and faces that do not fit each other, or others than at most times.
        """
        opened = open_stage(self.source, self.variants)
        time = self.times[index]
        with blamed(self.source, self.prim, time):
            prim = opened.stage.GetPrimAtPath(self.prim)
            points = opened.points.of(prim).world(time)
            if index in self.strays or self.reference is None:
                topology = read_topology(prim, time, len(points))
            if index in self.strays:
                raise InputError(self._difference(opened, prim, topology))
            if self.reference is not None:
                topology = self._shared(opened, prim)
            return Frame(time, points, topology)

    def skinning(self) -> Skinning | None:
        """Return how joints move the points, if they do; see `MeshPoints.skinning`."""
        opened = open_stage(self.source, self.variants)
        with blamed(self.source, self.prim):
            return opened.points.of(opened.stage.GetPrimAtPath(self.prim)).skinning()

    def _shared(self, opened: OpenStage, prim: Usd.Prim) -> Topology:
        assert self.reference is not None
        known = opened.topologies.get(self.prim)
        if known is None:
            time = self.times[self.reference]
            known = read_topology(prim, time, number_of_points(prim, time))
            opened.topologies[self.prim] = known
        return known

    def _difference(self, opened: OpenStage, prim: Usd.Prim, own: Topology) -> str:
        most = self._shared(opened, prim)
        if own.n_points != most.n_points:
            return f"{own.n_points} points here but {most.n_points} at most times"
        return "other faces, or points of another type, than at most times"


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
