"""What is written: is there a place for it, is it whole, and what does it read back as."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from meshmark.embedding.asset import MarkedAsset
from meshmark.embedding.manifest import manifest_path
from meshmark.errors import OutputError, UsageError
from meshmark.files.places import assets_folder, require_apart, require_names_fit
from meshmark.mesh.asset import Asset
from meshmark.sources.readers import LAYER_SUFFIXES, files_in_reach, read


def check_output(target: Path, source: str | Path | Asset, deliver: bool) -> None:
    """Refuse an output that could not or must not be written, before any work is done.

    Parameters
    ----------
    target : Path
        The output; what is written beside it is looked at, too.
    source : str, Path or Asset
        What will be, or was, read. None of the files it could ever use may be overwritten.
    deliver : bool
        Whether the output will be a deliverable.

    Raises
    ------
    UsageError
        If it is the source itself, or cannot be what was asked for.
    OutputError
        If it is part of the source, its name is too long, or its folder is missing or cannot be
        written to.
    """
    path = Path(source.source if isinstance(source, Asset) else source)
    if target.resolve() == path.resolve():
        raise UsageError("the output is the source itself", source=target)
    if deliver and target.suffix.lower() not in LAYER_SUFFIXES:
        raise UsageError(f"--deliver writes one of {', '.join(LAYER_SUFFIXES)}", source=target)
    beside = [manifest_path(target), *([assets_folder(target)] if deliver else [])]
    require_names_fit([target, *beside])
    require_apart([target, *beside], files_in_reach(source))
    if _joins(target, path):
        raise OutputError("would become a frame of the source", source=target)
    folder = target.parent
    if not folder.is_dir():
        raise OutputError("the folder to write into does not exist", source=folder)
    try:
        # Permissions do not tell the whole truth: full and read-only disks, special folders.
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise OutputError(
            f"the folder cannot be written to: {error.strerror}", source=folder
        ) from None
    if target.is_dir() and target.suffix.lower() in LAYER_SUFFIXES:
        raise OutputError("is a folder", source=target)
    if manifest_path(target).is_dir():
        raise OutputError("is a folder", source=manifest_path(target))
    place = assets_folder(target)
    if deliver and (place.is_symlink() or (place.exists() and not place.is_dir())):
        raise OutputError("is in the way: it must be a folder, or not there", source=place)


def _joins(target: Path, source: Path) -> bool:
    """Tell whether a file would be read with the frames of a folder or pattern from now on."""
    if source.is_dir():
        kinds = {file.suffix.lower() for file in source.iterdir()}
        return target.parent.resolve() == source.resolve() and target.suffix.lower() in kinds - {""}
    return not source.exists() and target.absolute().match(str(source.absolute()))


def complete(marked: MarkedAsset) -> Asset:
    """Return the marked meshes, and for a source that cannot be layered over, all others too."""
    if marked.original.reader == "usd":
        return marked.asset
    by_prim = {mesh.original.prim: mesh.animation for mesh in marked.meshes}
    meshes = tuple(by_prim.get(mesh.prim, mesh) for mesh in marked.original.meshes)
    return replace(marked.original, meshes=meshes)


def reread(marked: MarkedAsset, target: Path) -> Asset:
    """Read the marked meshes from where they were written, under the names they came with.

    A source that is no stage may hold names that are no prim paths: its meshes are written in
    order, and found again by it.
    """
    prims = [mesh.animation.prim for mesh in marked.meshes]
    if marked.original.reader == "usd":
        return read(target, prims)
    asset = read(target)
    named = [
        replace(written, prim=source.prim)
        for written, source in zip(asset.meshes, marked.original.meshes, strict=True)
    ]
    return replace(asset, meshes=tuple(mesh for mesh in named if mesh.prim in prims))
