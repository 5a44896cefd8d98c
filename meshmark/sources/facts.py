"""What else a source tells: its files, those it could use, and texture coordinates."""

from __future__ import annotations

from pathlib import Path

from meshmark.arrays import FloatArray
from meshmark.mesh.asset import Asset
from meshmark.sources.readers import files_named, files_there, find_reader
from meshmark.usd.names import READER
from meshmark.usd.reader import UsdReader


def source_files(source: str) -> list[Path]:
    """List the files a source consists of, sorted."""
    reader = find_reader(source)
    return files_named(source) if reader is None else reader.files(source)


def files_in_reach(source: str | Path | Asset) -> list[Path]:
    """List every file a source could use, whatever is selected or loaded; none if it is missing."""
    if isinstance(source, Asset):
        facts = source.facts
        return files_in_reach(source.source) if facts is None else [*map(Path, facts.reach)]
    reader = find_reader(str(source))
    return files_there(str(source)) if reader is None else reader.files_in_reach(str(source))


def texture_coordinates(asset: Asset, prim: str) -> FloatArray | None:
    """Read the texture coordinates of a mesh, where its kind of source has them for us.

    Returns
    -------
    (F, 3, 2) float64 or None
        For each corner of each triangle; None if there are none, or its reader knows of none.
    """
    if asset.facts is not None:
        return asset.facts.texture_coordinates(prim)
    usd = asset.reader == READER
    reader = UsdReader(asset.variants) if usd else find_reader(asset.source)
    return None if reader is None else reader.texture_coordinates(asset.source, prim)
