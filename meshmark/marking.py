"""Marks every mesh of an asset."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from meshmark.animation import Asset, LeftOut, MeshAnimation
from meshmark.embedding import Embedded, embed_animation
from meshmark.errors import CapacityError
from meshmark.keys import Key
from meshmark.parallel import sharing_workers
from meshmark.recipe import Recipe
from meshmark.recipients import recipient_name
from meshmark.timeline import frames_in, in_range

MeshProgress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class MarkedMesh:
    """One mesh that was marked."""

    original: MeshAnimation
    embedded: Embedded

    @property
    def animation(self) -> MeshAnimation:
        """The marked animation."""
        return self.embedded.animation


@dataclass(frozen=True, eq=False)
class MarkedAsset:
    """An asset of which at least one mesh was marked.

    Parameters
    ----------
    original : Asset
        As it was read.
    meshes : tuple of MarkedMesh
        Those that hold a mark.
    skipped : tuple of LeftOut
        Those that cannot.
    """

    original: Asset
    meshes: tuple[MarkedMesh, ...]
    skipped: tuple[LeftOut, ...]

    @property
    def asset(self) -> Asset:
        """The marked meshes alone, in the original's order."""
        return replace(self.original, meshes=tuple(mesh.animation for mesh in self.meshes))


@sharing_workers
def embed(
    asset: Asset | MeshAnimation,
    key: Key,
    *,
    recipe: Recipe | None = None,
    recipient: str | None = None,
    frames: str | None = None,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> MarkedAsset:
    """Mark an asset.

    Parameters
    ----------
    asset : Asset or MeshAnimation
        What `meshmark.read` gave, or one animation of it.
    key : Key
        The owner's key.
    recipe : Recipe, optional
        Scheme, segmenter and solver with their parameters; the defaults where not given.
    recipient : str, optional
        Whose copy this will be: `verify` can then name them. See `recipient_name`.
    frames : str, optional
        Range A:B[:S] of time codes to mark; the others stay as they are.
    jobs : int
        Worker processes. With more than one, a script that calls this needs the usual
        ``if __name__ == "__main__"``.
    progress : callable, optional
        Called with (prim, frames done, frames in all).

    Returns
    -------
    MarkedAsset
        Displacements lie in scratch files that live as long as the result.

    Raises
    ------
    CapacityError
        If no mesh can hold a mark. Some meshes of several that cannot are listed as skipped.
    UsageError
        If the recipient's is no name, or no mesh has a frame in the range; those that have none
        beside others are listed as skipped.
    """
    whose = None if recipient is None else recipient_name(recipient)
    whole = asset if isinstance(asset, Asset) else as_asset(asset)
    scheme = (recipe or Recipe()).build()
    name = (recipe or Recipe()).scheme
    marked: list[MarkedMesh] = []
    within, beyond = in_range(whole, frames)
    skipped = list(beyond)
    for animation in within.meshes:
        tell = None if progress is None else partial(progress, animation.prim)
        try:
            embedded = embed_animation(
                animation,
                scheme,
                name,
                key,
                recipient=whose,
                frames=frames_in(animation, frames),
                jobs=jobs,
                progress=tell,
            )
        except CapacityError as error:
            if len(within.meshes) == 1:
                raise
            skipped.append(LeftOut(animation.prim, error.message))
            continue
        marked.append(MarkedMesh(animation, embedded))
    if not marked:
        reasons = "; ".join(f"{each.prim}: {each.reason}" for each in skipped[:3])
        raise CapacityError(f"no mesh can hold a mark: {reasons}", source=whole.source)
    return MarkedAsset(whole, tuple(marked), tuple(skipped))


def as_asset(animation: MeshAnimation) -> Asset:
    """Wrap one animation as an asset of its own."""
    return Asset(source=animation.origin, meshes=(animation,), reader="memory")
