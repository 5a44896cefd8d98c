"""Opens and writes sources of any kind: stages by the core, all else by reader plugins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from glob import glob
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from meshmark.errors import InputError, UsageError
from meshmark.extension.registry import catalogue, make_reader
from meshmark.files.atomic import require_no_device
from meshmark.mesh.asset import Asset

if TYPE_CHECKING:
    from meshmark.usd.delivery import Delivery

STAGE_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
LAYER_SUFFIXES = (".usd", ".usda", ".usdc")


def is_stage(source: str) -> bool:
    """Tell whether a source is one of USD's own files."""
    return source.lower().endswith(STAGE_SUFFIXES)


def read(source: str | Path, prims: Sequence[str] = (), *, isolated: bool = False) -> Asset:
    """Read every mesh of a USD file, a folder or glob of OBJ frames, or a glTF file.

    Parameters
    ----------
    source : str or Path
        What to read.
    prims : sequence of str
        Paths of the meshes wanted; all where empty.
    isolated : bool
        For files nobody vouches for: all is read now, in a process of its own with limits on
        memory and time; see `meshmark.sources.isolation.reading`.

    Returns
    -------
    Asset
        Its animations read their frames lazily.

    Raises
    ------
    InputError
        If the source is missing, unreadable or holds no mesh.
    UsageError
        If a wanted mesh is not in it.
    """
    name = str(source)
    require_no_device(Path(name))
    if isolated:
        from meshmark.sources.isolation.reading import read_isolated

        return read_isolated(name, prims)
    if is_stage(name):
        from meshmark.usd.reading import read_stage

        return read_stage(name, list(prims) or None)
    for offer in catalogue().of_kind("reader"):
        reader = make_reader(offer.name)
        if reader.accepts(name):
            asset = reader.read(name)
            if not prims:
                return asset
            return replace(asset, meshes=tuple(asset.mesh(prim) for prim in prims))
    if not Path(name).exists():
        raise InputError("no such file or folder", source=name)
    known = ", ".join(offer.name for offer in catalogue().of_kind("reader"))
    raise InputError(
        f"nothing here reads it: not USD, and none of the readers {known}", source=name
    )


def files_in_reach(source: str | Path | Asset) -> list[Path]:
    """List every file a source could use, whatever is selected or loaded; none if it is missing."""
    if isinstance(source, Asset):
        facts = source.facts
        return files_in_reach(source.source) if facts is None else [*map(Path, facts.reach)]
    path = Path(source)
    if path.name.lower().endswith(STAGE_SUFFIXES) and path.is_file():
        from meshmark.usd.reach import files_in_reach as of_stage

        return of_stage(str(source))
    if path.is_dir():
        return [file for file in path.iterdir() if file.is_file()]
    # Path.glob takes no absolute patterns.
    return [path] if path.exists() else [Path(name) for name in glob(str(source), recursive=True)]  # noqa: PTH207


def source_files(source: str) -> list[Path]:
    """List the files a source consists of, sorted."""
    if is_stage(source):
        from meshmark.usd.opening import stage_files

        return sorted(stage_files(source))
    path = Path(source)
    if path.is_dir():
        return sorted(entry for entry in path.iterdir() if entry.is_file())
    # Path.glob takes no absolute patterns.
    return sorted(Path(name) for name in glob(source)) or [path]  # noqa: PTH207


def texture_coordinates(asset: Asset, prim: str) -> NDArray[np.float64] | None:
    """Read the texture coordinates of a mesh, where its kind of source has them for us.

    Returns
    -------
    (F, 3, 2) float64 or None
        For each corner of each triangle; None if there are none, or the source is no stage.
    """
    if asset.facts is not None:
        return asset.facts.texture_coordinates(prim)
    if asset.reader != "usd":
        return None
    from meshmark.usd.texture_coordinates import read_texture_coordinates

    return read_texture_coordinates(asset.source, prim)


def write(marked: Asset, original: Asset, output: str | Path, *, deliver: bool = False) -> None:
    """Write a marked asset beside its original.

    Parameters
    ----------
    marked : Asset
        The marked meshes; those of `original` that are missing here stay as they are.
    original : Asset
        As it was read.
    output : str or Path
        A USD layer: an override that sublayers a USD source, or a whole stage for any other.
        Or what the original's own reader writes, such as a folder of OBJ frames.
    deliver : bool
        Flatten into one file in which no unmarked point is left.

    Raises
    ------
    UsageError
        If the output's kind does not fit the source.
    OutputError
        If it cannot be written; nothing half-written is left.
    """
    writer(original, output, deliver=deliver)(marked)


def writer(
    original: Asset, output: str | Path, *, deliver: bool = False, keep_metadata: bool = False
) -> Callable[[Asset], Delivery | None]:
    """Return what `write` would call with the marked asset, so that a bad output is known early.

    Raises
    ------
    UsageError
        If the output's kind does not fit the source.
    """
    path = Path(output)
    if path.suffix.lower() in LAYER_SUFFIXES:
        return _layer_writer(original, path, deliver, keep_metadata)
    if original.reader == "usd":
        raise UsageError(
            f"a USD source is written as {', '.join(LAYER_SUFFIXES)}, not to {str(output)!r}"
        )
    reader = make_reader(original.reader)
    if not reader.writes(path):
        raise UsageError(
            f"the {original.reader} reader cannot write to {str(output)!r}; "
            f"{', '.join(LAYER_SUFFIXES)} always can be"
        )
    return partial(reader.write, original=original, output=path)


def _layer_writer(
    original: Asset, path: Path, deliver: bool, keep_metadata: bool
) -> Callable[[Asset], Delivery | None]:
    if original.reader != "usd":
        from meshmark.usd.stages import write_stage

        return partial(write_stage, output=path)
    if deliver:
        from meshmark.usd.delivery import write_flattened

        return partial(write_flattened, original, output=path, keep_metadata=keep_metadata)
    from meshmark.usd.writing import write_override

    return partial(write_override, original, output=path)
