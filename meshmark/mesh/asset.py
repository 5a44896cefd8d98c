"""What is read from one source: the animations of its meshes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

from meshmark.arrays import FloatArray
from meshmark.errors import UsageError
from meshmark.mesh.animation import MeshAnimation


@dataclass(frozen=True)
class LeftOut:
    """Something of a source that was not read, or not marked.

    Parameters
    ----------
    prim : str
        Path of the mesh, or of the prim that would hold it.
    reason : str
        Why.
    guide : bool
        Whether it only helps those who work on the source, and nobody expects a mark in it.
    """

    prim: str
    reason: str
    guide: bool = False


class SourceFacts(Protocol):
    """What else of a source was read with its frames, so that nobody has to open it again."""

    @property
    def files(self) -> tuple[tuple[str, str], ...]:
        """Absolute path and SHA-256 of each file the source consists of."""
        ...

    @property
    def reach(self) -> tuple[str, ...]:
        """Every file it could use; see `meshmark.sources.facts.files_in_reach`."""
        ...

    def texture_coordinates(self, prim: str) -> FloatArray | None:
        """Return those of a mesh; see `meshmark.sources.facts.texture_coordinates`."""
        ...


@dataclass(frozen=True, eq=False)
class Asset:
    """Everything read from one source: the animations of its meshes.

    Parameters
    ----------
    source : str
        What was asked for: a path, a folder or a glob.
    meshes : tuple of MeshAnimation
        One for each mesh that can be read, in the file's own order.
    reader : str
        Name of the reader that produced it ("usd", "obj", ...).
    up_axis : str
        "Y" or "Z".
    meters_per_unit : float
        Length of the source's unit in metres.
    fps : float
        Time codes per second.
    notes : tuple of str
        What a person should know about how it was read.
    left_out : tuple of LeftOut
        What of it was not read.
    facts : SourceFacts or None
        What was read with it; None where the source is asked again.
    variants : tuple of str
        The variants it was read with that somebody asked for, each `PRIM{SET=NAME}`.
    """

    source: str
    meshes: tuple[MeshAnimation, ...]
    reader: str
    up_axis: str = "Y"
    meters_per_unit: float = 0.01
    fps: float = 24.0
    notes: tuple[str, ...] = field(default=())
    left_out: tuple[LeftOut, ...] = ()
    facts: SourceFacts | None = None
    variants: tuple[str, ...] = ()

    @property
    def path(self) -> Path:
        """The source as a path."""
        return Path(self.source)

    def mesh(self, prim: str) -> MeshAnimation:
        """Return the animation of one prim.

        Raises
        ------
        UsageError
            If the asset has no such mesh; the message lists those it has.
        """
        for animation in self.meshes:
            if animation.prim == prim:
                return animation
        known = ", ".join(animation.prim for animation in self.meshes[:10])
        raise UsageError(f"no mesh at {prim}; there is {known}", source=self.source)

    def with_meshes(self, meshes: Iterable[MeshAnimation]) -> Asset:
        """Return it with some of its meshes exchanged for others of the same prims.

        Raises
        ------
        UsageError
            If it has no mesh of that prim.
        """
        by_prim = {self.mesh(mesh.prim).prim: mesh for mesh in meshes}
        new = tuple(by_prim.get(mesh.prim, mesh) for mesh in self.meshes)
        return replace(self, meshes=new)


def as_asset(animation: MeshAnimation) -> Asset:
    """Wrap one animation as an asset of its own."""
    return Asset(source=animation.origin, meshes=(animation,), reader="memory")
