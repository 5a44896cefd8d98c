"""Whether there is a place for an output, and a master, asked before any work is done."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from meshmark.c2pa.sidecar import sidecar_path
from meshmark.embedding.manifest import manifest_path
from meshmark.errors import OutputError, UsageError
from meshmark.extension.recipe import Recipe
from meshmark.files.places import assets_folder, data_file, require_apart, require_names_fit
from meshmark.mesh.asset import Asset
from meshmark.sources.facts import files_in_reach
from meshmark.sources.writing import writer
from meshmark.usd.names import KEEP, LAYER_SUFFIXES, REST_POSE


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
    beside = [manifest_path(target), data_file(target, 0)]
    beside += [assets_folder(target)] if deliver else []
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


def master_keeper(
    master: str | Path | None,
    original: Asset,
    target: Path,
    parameters: Mapping[str, Any] | None,
    layers: Sequence[Recipe],
    skel: str,
    primvars: str,
) -> Callable[[Asset], object]:
    """Return what writes the master, or does nothing if none is asked for.

    Raises
    ------
    UsageError, OutputError
        If it cannot be written there, or no blind layer would be in it.
    """
    if master is None:
        return lambda _: None
    path = Path(master)
    if all(layer.informed for layer in layers):
        raise UsageError("--master keeps what blind layers made; there is none")
    if path.resolve() == target.resolve():
        raise UsageError("the master is the output", source=path)
    check_output(path, original, deliver=False)
    # `verify` reads points alone. But a rest pose is posed by what follows.
    primvars = primvars if skel == REST_POSE else KEEP
    return writer(original, path, parameters=parameters, skel=skel, primvars=primvars)


def places_together(
    target: Path, master: str | Path | None, record: object, signer: object
) -> list[Path]:
    """List what is to be there whole, or as it was before, if that is more than the output.

    A copy that is to be recorded, or signed, is nothing without.
    """
    if record is None and signer is None:
        return []
    places = [target, *([] if master is None else [Path(master)])]
    return places if signer is None else [*places, sidecar_path(target)]
