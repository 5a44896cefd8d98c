"""The files a stage could ever use, whatever is selected, loaded or asked for."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from pxr import Ar, Sdf, UsdUtils

from meshmark.errors import InputError
from meshmark.files.places import require_apart
from meshmark.usd.diagnostics import caught


def files_in_reach(source: str) -> list[Path]:
    """List every file a stage names, itself first, whether it is there or not.

    Layers of all variants, payloads, references and value clips, textures and their tiles, and
    whatever else any attribute or metadata names as an asset. A package counts as one file.
    Layers that cannot be read are in the list as well, though not what they name. Names that
    no file can have are not.
    """
    names = dict.fromkeys([source])

    def remember(layer: Sdf.Layer, found: UsdUtils.DependencyInfo) -> UsdUtils.DependencyInfo:
        for path in (found.assetPath, *found.dependencies):
            # A path without a leading dot is first looked for beside the layer, then elsewhere.
            for each in (path, f"./{path}"):
                anchored = Sdf.ComputeAssetPathRelativeToLayer(layer, each)
                outer, _ = Ar.SplitPackageRelativePathOuter(anchored)
                names[outer or anchored] = None
        return found

    # What cannot be read is told of when it is needed; the rest has been gone through by then.
    with suppress(InputError), caught(source):
        UsdUtils.ComputeAllDependencies(source, remember)
    # No file has a NUL byte in its name, and no system can be asked for one.
    return [Path(name) for name in names if name and "\0" not in name]


def refuse_to_overwrite(source: str, output: Path) -> None:
    """Refuse an output that is one of the files a stage could use.

    Raises
    ------
    OutputError
        If it is.
    """
    require_apart([output], files_in_reach(source))
