"""Two differently marked copies made into one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshmark.errors import UsageError
from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation
from meshmark.sources.reading import read
from meshmark_plugins.attacks.parameters import choice


@dataclass(frozen=True)
class Collusion:
    """Blend the animation with another copy of it.

    Parameters
    ----------
    other : MeshAnimation, str or Path
        The other copy: as many frames and vertices. From a file, the mesh at the same prim is
        taken, or the only one there is.
    kind : {"mean", "alternate"}
        The mean of both copies, or odd frames from one and even frames from the other.

    Raises
    ------
    UsageError
        If `kind` is out of range, or, when it is applied, the other copy is not given or not
        alike.
    """

    other: MeshAnimation | str | Path | None = None
    kind: str = "mean"

    def __post_init__(self) -> None:
        choice("collusion", "kind", self.kind, ("mean", "alternate"))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return what the two copies make."""
        other = self._other(animation.prim)
        if len(other) != len(animation):
            raise UsageError(
                f"attack collusion: the other copy has {len(other)} frames, not {len(animation)}",
                source=animation.origin or None,
                prim=animation.prim,
            )
        if self.kind == "alternate":
            blended: FrameSource = AlternatingFrames(animation.source, other.source)
        else:
            blended = MeanFrames(animation.source, other.source)
        constant = animation.constant_topology and animation[0].topology.same_as(other[0].topology)
        return replace(animation, source=blended, constant_topology=constant)

    def _other(self, prim: str) -> MeshAnimation:
        if self.other is None:
            raise UsageError("attack collusion: other, a second copy, must be given")
        if isinstance(self.other, MeshAnimation):
            return self.other
        asset = read(self.other)
        return asset.meshes[0] if len(asset.meshes) == 1 else asset.mesh(prim)


@dataclass(frozen=True)
class AlternatingFrames:
    """Even indices from one source, odd ones from another."""

    even: FrameSource
    odd: FrameSource

    def frame(self, index: int) -> Frame:
        """Read frame `index` from the source whose turn it is."""
        frame = self.even.frame(index)
        return frame if index % 2 == 0 else replace(self.odd.frame(index), time=frame.time)


@dataclass(frozen=True)
class MeanFrames:
    """The mean of two sources' points."""

    one: FrameSource
    two: FrameSource

    def frame(self, index: int) -> Frame:
        """Read frame `index` of both and take the mean."""
        one, two = self.one.frame(index), self.two.frame(index)
        if not one.topology.same_as(two.topology):
            raise UsageError("attack collusion: the copies have different faces", time=one.time)
        return one.moved((one.points + two.points) / 2)
