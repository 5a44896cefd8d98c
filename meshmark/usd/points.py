"""The points of a mesh prim as its stage shows them: posed, where a rig poses them."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd

from meshmark.arrays import FloatArray
from meshmark.errors import InputError
from meshmark.mesh.checks import require_measurable
from meshmark.mesh.skinning import Skinning
from meshmark.usd.blend_shapes import shared_shapes
from meshmark.usd.diagnostics import caught
from meshmark.usd.geometry import REST, local_points, local_to_world, sample_times, world_points
from meshmark.usd.influences import Influences
from meshmark.usd.skinning import Rig, rigs_below, skel_root

Points = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class MeshPoints:
    """The points of one mesh prim.

    Parameters
    ----------
    prim : Usd.Prim
        The mesh.
    rig : Rig or None
        What poses it.
    broken : str
        Why a rig that it is bound to cannot; empty if it can, or there is none.
    """

    prim: Usd.Prim
    rig: Rig | None = None
    broken: str = ""

    @property
    def notes(self) -> tuple[str, ...]:
        """What a person should know about how they are read."""
        if self.broken:
            return (f"rigged, and read in its rest pose: {self.broken}",)
        return () if self.rig is None else (f"rigged: posed by {self.rig.bone.GetPath()}",)

    def times(self) -> FloatArray:
        """Return the times at which they are sampled, or a single NaN if they are not."""
        if self.rig is None:
            return sample_times(self.prim)
        return self.rig.times if self.rig.times.size else np.array([np.nan])

    @property
    def has_rest_pose(self) -> bool:
        """Whether a rig poses them, and from the same rest pose at all times."""
        return self.rig is not None and bool(np.isnan(sample_times(self.prim)).all())

    def skinning(self) -> Skinning | None:
        """Return how joints move them; None if they do not, or not always alike.

        Raises
        ------
        InputError
            As `local`.
        """
        if self.rig is None or not self.has_rest_pose:
            return None
        rest = self.local(REST).astype(np.float64)
        found = self.rig.influences or Influences.of(self.rig.skinning, len(rest))
        return None if found is None else Skinning.fit(rest, found.indices, found.weights)

    def local(self, time: float) -> Points:
        """Return them in the prim's own space and type, (N, 3); at `REST`, before a rig poses them.

        Raises
        ------
        InputError
            If there are none, one is not finite, or the rig does not fit them; the caller adds
            where.
        """
        rest = local_points(self.prim, time)
        if self.rig is None or time == REST:
            return rest
        with np.errstate(over="ignore", invalid="ignore"):
            posed = self.rig.pose(rest, time).astype(rest.dtype)
        require_measurable(posed)
        return posed

    def world(self, time: float) -> FloatArray:
        """Return them in world space, (N, 3).

        Raises
        ------
        InputError
            As `local`, or if one is too far away to compute with.
        """
        return world_points(self.local(time), local_to_world(self.prim, time))


@dataclass(frozen=True, eq=False)
class StagePoints:
    """The points of all meshes of a stage; its rigs are looked at once.

    Parameters
    ----------
    stage : Usd.Stage
        Must not be edited.
    """

    stage: Usd.Stage
    _rigs: dict[str, dict[str, Rig]] = field(default_factory=dict, init=False)
    _known: dict[str, MeshPoints] = field(default_factory=dict, init=False)

    def of(self, prim: Usd.Prim) -> MeshPoints:
        """Return those of a mesh prim."""
        path = str(prim.GetPath())
        if path not in self._known:
            rig = self._rig(prim)
            self._known[path] = MeshPoints(prim) if rig is None else _tried(prim, rig)
        return self._known[path]

    @cached_property
    def shared_shapes(self) -> frozenset[Sdf.Path]:
        """Blend shapes that are not one mesh's own."""
        return shared_shapes(self.stage)

    def _rig(self, prim: Usd.Prim) -> Rig | None:
        root = skel_root(prim)
        if root is None:
            return None
        path = str(root.GetPath())
        if path not in self._rigs:
            self._rigs[path] = rigs_below(root)
        return self._rigs[path].get(str(prim.GetPath()))


def _tried(prim: Usd.Prim, rig: Rig) -> MeshPoints:
    """Return the points of a prim as its rig poses them, if it can."""
    with suppress(InputError):
        rest = local_points(prim, np.nan)
        try:
            with caught(str(prim.GetPath())) as said:
                rig.deformed(rest, np.nan)
        except InputError as error:
            return MeshPoints(prim, broken="; ".join((error.message, *said)))
    # Without points, whoever reads them says so.
    return MeshPoints(prim, rig)
