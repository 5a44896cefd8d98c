"""Paths to textures in a flattened layer, so that they still lead somewhere from its new place."""

from __future__ import annotations

import zipfile
from pathlib import Path, PurePosixPath

from pxr import Ar, Sdf, UsdUtils

from meshmark.errors import OutputError
from meshmark.usd.layers import sublayer_path


def anchor_asset_paths(layer: Sdf.Layer, output: Path) -> None:
    """Rewrite the absolute asset paths that flattening leaves, for a layer to lie at `output`.

    A path to a layer, such as the identifier in `assetInfo`, is removed: nothing in a flattened
    layer needs it, and it may lead to unmarked points. A path into a package becomes a path to a
    copy in the folder `<name of output>.assets`. Other absolute paths become relative. Paths
    that flattening could not resolve stay as they are.
    """

    def anchored(path: str) -> str:
        if Sdf.FileFormat.FindByExtension(path):
            return ""
        if Ar.IsPackageRelativePath(path):
            return sublayer_path(_unpacked(path, output), output)
        return sublayer_path(Path(path), output) if Path(path).is_absolute() else path

    UsdUtils.ModifyAssetPaths(layer, anchored)


def _unpacked(path: str, output: Path) -> Path:
    """Copy a file out of the package it lies in, beside the output."""
    package, inner = Ar.SplitPackageRelativePathOuter(path)
    if ".." in PurePosixPath(inner).parts:
        raise OutputError(f"{package} holds a file that would leave it: {inner}", source=output)
    copy: Path = output.with_name(f"{output.name}.assets") / inner
    try:
        with zipfile.ZipFile(package) as archive:
            data = archive.read(inner)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(data)
    except (OSError, KeyError, zipfile.BadZipFile) as error:
        raise OutputError(f"cannot copy {inner} out of {package}: {error}", source=output) from None
    return copy
