"""Marks every mesh of an asset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from meshmark.embedding.layers import Layer, mark_layers
from meshmark.embedding.mesh import Embedded
from meshmark.errors import CapacityError, InputError, MeshmarkError, NoExtentError
from meshmark.extension.recipe import Recipe, in_order
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, LeftOut, as_asset
from meshmark.mesh.checks import bad_frames
from meshmark.mesh.frame_range import frames_in, in_range
from meshmark.recipients import recipient_name
from meshmark.workers.ordered_map import prepare_workers, sharing_workers
from meshmark.workers.progress import MeshProgress


@dataclass(frozen=True, eq=False)
class MarkedMesh:
    """One mesh that was marked.

    Parameters
    ----------
    original : MeshAnimation
        As it was read.
    layers : tuple of Embedded
        As each layer marked it, one upon the other.
    passed_over : tuple of (float, MeshmarkError)
        Times at which it is scaled to nothing (`NoExtentError`), or where its connectivity
        changes, can hold no mark; those frames stay as they are.
    missing : tuple of (str, str)
        Layers that it could not hold, and why.
    """

    original: MeshAnimation
    layers: tuple[Embedded, ...]
    passed_over: tuple[tuple[float, MeshmarkError], ...] = ()
    missing: tuple[tuple[str, str], ...] = ()

    @property
    def animation(self) -> MeshAnimation:
        """The marked animation."""
        return self.layers[-1].animation

    @property
    def master(self) -> MeshAnimation:
        """The animation as the blind layers left it."""
        blind = [layer.animation for layer in self.layers if not layer.informed]
        return blind[-1] if blind else self.original

    @property
    def frames(self) -> tuple[int, ...]:
        """Indices of the marked frames."""
        return tuple(sorted({index for layer in self.layers for index in layer.frames}))

    @property
    def carriers(self) -> int:
        """Number of carriers of all layers."""
        return sum(layer.carriers for layer in self.layers)


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

    @property
    def master(self) -> Asset:
        """The same meshes as the blind layers left them: copies are read beside these."""
        return replace(self.original, meshes=tuple(mesh.master for mesh in self.meshes))


@sharing_workers
def embed(
    asset: Asset | MeshAnimation,
    key: Key,
    *,
    recipe: Recipe | Sequence[Recipe] | None = None,
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
    recipe : Recipe or sequence of Recipe, optional
        Schemes with their parameters, a layer each; `default_layers` where not given.
    recipient : str, optional
        Whose copy this will be: `verify` can then name them. See `recipient_name`. Beside an
        informed layer, blind ones hold the owner's words alone.
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
    InputError
        If a frame in the range cannot be read.
    CapacityError
        If no mesh can hold a mark. Some meshes of several that cannot are listed as skipped.
    UsageError
        If the recipient's is no name, or no mesh has a frame in the range; those that have none
        beside others are listed as skipped.
    """
    whose = None if recipient is None else recipient_name(recipient)
    whole = asset if isinstance(asset, Asset) else as_asset(asset)
    layers = [Layer.of(each) for each in in_order(recipe)]
    marked: list[MarkedMesh] = []
    within, beyond = in_range(whole, frames)
    skipped = list(beyond)
    longest = max((len(mesh) for mesh in within.meshes), default=0)
    prepare_workers([type(layer.scheme).__module__ for layer in layers], longest)
    # All of them first: what cannot be read is to be known before hours of work.
    passed_over = {mesh.prim: _passed_over(mesh, frames) for mesh in within.meshes}
    for animation in within.meshes:
        tell = None if progress is None else partial(progress, animation.prim)
        empty = passed_over[animation.prim]
        chosen = _remaining(animation, frames, empty)
        try:
            done, missing, unheld = mark_layers(
                animation, layers, key, whose, chosen, jobs=jobs, progress=tell
            )
        except CapacityError as error:
            if len(within.meshes) == 1:
                raise
            skipped.append(LeftOut(animation.prim, error.message))
            continue
        left = sorted({**empty, **unheld}.items())
        told = tuple((float(animation.times[index]), error) for index, error in left)
        marked.append(MarkedMesh(animation, done, told, missing))
    if not marked:
        reasons = "; ".join(f"{each.prim}: {each.reason}" for each in skipped[:3])
        raise CapacityError(f"no mesh can hold a mark: {reasons}", source=whole.source)
    return MarkedAsset(whole, tuple(marked), tuple(skipped))


def _passed_over(animation: MeshAnimation, frames: str | None) -> dict[int, NoExtentError]:
    """Find the frames with nothing to mark in them; any other that is unfit raises."""
    if animation.flaw:
        raise InputError(animation.flaw, source=animation.origin, prim=animation.prim)
    chosen = frames_in(animation, frames)
    found: dict[int, NoExtentError] = {}
    for index, error in bad_frames(animation.select(chosen)):
        if not isinstance(error, NoExtentError):
            raise error
        found[chosen[index]] = error
    return found


def _remaining(
    animation: MeshAnimation, frames: str | None, passed_over: Mapping[int, NoExtentError]
) -> tuple[int, ...]:
    kept = tuple(index for index in frames_in(animation, frames) if index not in passed_over)
    if not kept:
        raise CapacityError(
            next(iter(passed_over.values())).message,
            source=animation.origin,
            prim=animation.prim,
        )
    return kept
