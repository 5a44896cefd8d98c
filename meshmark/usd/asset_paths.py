"""Paths to textures in a flattened layer, so that they still lead somewhere from its new place."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from glob import escape, glob
from pathlib import Path, PureWindowsPath

import numpy as np
from pxr import Ar, Sdf, Usd, UsdUtils

from meshmark.files.places import assets_folder
from meshmark.usd.layers import set_value, sublayer_path, value_at
from meshmark.usd.metadata import file_name, paths_of
from meshmark.usd.unpacking import UDIM, Unpacking


@dataclass(frozen=True)
class AnchoredPaths:
    """What became of paths to textures that lie outside the folder of a deliverable.

    Parameters
    ----------
    cut : tuple of str
        The names left of paths that led nowhere.
    outside : tuple of str
        Relative paths that climb out of the folder.
    """

    cut: tuple[str, ...]
    outside: tuple[str, ...]


def anchor_asset_paths(
    layer: Sdf.Layer, stage: Usd.Stage, output: Path, unpacked: Path, keep_lost: bool = False
) -> AnchoredPaths:
    """Rewrite the asset paths that flattening leaves, for a layer to lie at `output`.

    A path to a layer, such as the identifier in `assetInfo`, is removed: nothing in a flattened
    layer needs it, and it may lead to unmarked points. A path into a package becomes a path to a
    copy in the folder `<name of output>.assets`. Other absolute paths become relative; of those
    that lead nowhere, and would only tell the names of folders, the file's name is left.

    Parameters
    ----------
    layer : Sdf.Layer
        The flattened layer.
    stage : Usd.Stage
        What it was flattened from, without instances.
    output : Path
        Where the layer will lie.
    unpacked : Path
        The folder to make, if anything is copied, that will become the one beside the output.
    keep_lost : bool
        Keep the folders of paths that lead nowhere.

    Returns
    -------
    AnchoredPaths

    Raises
    ------
    OutputError
        If a file cannot be copied out of its package, or its name could lead out of the folder.
    """
    unpacking = Unpacking(unpacked)
    cut: dict[str, None] = {}
    outside: dict[str, None] = {}

    def anchored(path: str) -> str:
        if Sdf.FileFormat.FindByExtension(path):
            return ""
        if Ar.IsPackageRelativePath(path):
            copied = assets_folder(output) / unpacking.copy(path)
            return sublayer_path(copied, output)
        elsewhere = PureWindowsPath(path).drive != "" or path.startswith("~")
        if not Path(path).is_absolute() and not elsewhere:
            return path
        relative = path if elsewhere else sublayer_path(Path(path), output)
        if relative.startswith("./"):
            return relative
        if keep_lost or _exists(path):
            outside[relative] = None
            return relative
        name = file_name(path)
        cut[f"{name}: the folders of a path that leads nowhere"] = None
        return name

    _anchor_tiles(layer, stage)
    UsdUtils.ModifyAssetPaths(layer, anchored)
    return AnchoredPaths(tuple(cut), tuple(outside))


def _anchor_tiles(layer: Sdf.Layer, stage: Usd.Stage) -> None:
    """Make paths to tiled textures absolute where flattening did not.

    USD looks a path without a leading dot up as a file, and no file is called <UDIM>.
    """
    for path, time, value in _asset_values(layer):
        paths = [value.path] if isinstance(value, Sdf.AssetPath) else [each.path for each in value]
        if not any(map(_is_loose, paths)):
            continue
        code = Usd.TimeCode.Default() if np.isnan(time) else Usd.TimeCode(time)
        author = next(iter(stage.GetAttributeAtPath(path).GetPropertyStack(code)), None)
        if author is None:
            continue
        found = [Sdf.AssetPath(_found(each, author.layer)) for each in paths]
        new = found[0] if isinstance(value, Sdf.AssetPath) else Sdf.AssetPathArray(found)
        set_value(layer, path, time, new)


def _asset_values(
    layer: Sdf.Layer,
) -> Iterator[tuple[Sdf.Path, float, Sdf.AssetPath | Sdf.AssetPathArray]]:
    types = (Sdf.ValueTypeNames.Asset, Sdf.ValueTypeNames.AssetArray)
    for path in filter(Sdf.Path.IsPrimPropertyPath, paths_of(layer)):
        attribute = layer.GetAttributeAtPath(path)
        if attribute is None or attribute.typeName not in types:
            continue
        for time in (np.nan, *layer.ListTimeSamplesForPath(path)):
            value = value_at(layer, path, time)
            if isinstance(value, Sdf.AssetPath | Sdf.AssetPathArray):
                yield path, time, value


def _is_loose(path: str) -> bool:
    return UDIM in path and not path.startswith(".") and not Path(path).is_absolute()


def _found(path: str, layer: Sdf.Layer) -> str:
    """Anchor a path to the layer that authored it, if its tiles are there."""
    if not _is_loose(path):
        return path
    anchored: str = Sdf.ComputeAssetPathRelativeToLayer(layer, f"./{path}")
    if Ar.IsPackageRelativePath(anchored):
        return anchored
    return anchored if _exists(anchored) else path


def _exists(path: str) -> bool:
    """Tell whether there is a file, or a tile of a texture."""
    if "\0" in path:
        # No file has such a name, and glob raises.
        return False
    before, tiled, after = path.partition(UDIM)
    if not tiled:
        return os.path.exists(path)  # noqa: PTH110 (Path raises where a name is too long)
    return bool(glob(f"{escape(before)}[0-9][0-9][0-9][0-9]{escape(after)}"))  # noqa: PTH207
