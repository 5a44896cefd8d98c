"""Which reader a source has: USD's, which is the core's own, or a plugin's."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from glob import glob
from pathlib import Path
from typing import Any

from meshmark.arrays import FloatArray
from meshmark.errors import InputError, UsageError
from meshmark.extension.interfaces import Reader, SourceReader
from meshmark.extension.registry import catalogue, make_reader
from meshmark.mesh.asset import Asset
from meshmark.usd.names import READER
from meshmark.usd.reader import UsdReader


@dataclass(frozen=True)
class PluginReader:
    """A plugin's reader, together with all that it may leave out.

    Parameters
    ----------
    reader : Reader
        As the plugin makes it.
    name : str
        What it is called.
    """

    reader: Reader
    name: str = ""

    def accepts(self, source: str) -> bool:
        """Ask the reader."""
        return self.reader.accepts(source)

    def read(self, source: str, prims: Sequence[str] = ()) -> Asset:
        """Read the source, and keep the meshes wanted; all where none is named."""
        asset = self.reader.read(source)
        return replace(asset, meshes=tuple(map(asset.mesh, prims))) if prims else asset

    def files(self, source: str) -> list[Path]:
        """Ask the reader, or list the source itself: a file, a folder's, or a pattern's."""
        own = getattr(self.reader, "files", files_named)
        return list(own(source))

    def files_in_reach(self, source: str) -> list[Path]:
        """Ask the reader, or list the source itself."""
        own = getattr(self.reader, "files_in_reach", files_there)
        return list(own(source))

    def texture_coordinates(self, source: str, prim: str) -> FloatArray | None:
        """Ask the reader, or say that there are none."""
        own = getattr(self.reader, "texture_coordinates", None)
        found: FloatArray | None = None if own is None else own(source, prim)
        return found

    def require_writable(self, source: str, output: Path) -> None:
        """Ask the reader, or refuse nothing."""
        own = getattr(self.reader, "require_writable", None)
        if own is not None:
            own(source, output)

    def writes(self, output: Path) -> bool:
        """Ask the reader."""
        return self.reader.writes(output)

    def write(self, marked: Asset, original: Asset, output: Path) -> None:
        """Let the reader write, given all meshes."""
        self.reader.write(original.with_meshes(marked.meshes), original, output)

    def written_names(self, original: Asset) -> dict[str, str]:
        """Ask the reader, or say that meshes keep their names."""
        own = getattr(self.reader, "written_names", None)
        if own is not None:
            return dict(own(original))
        return {mesh.prim: mesh.prim for mesh in original.meshes}

    @property
    def writes_new(self) -> bool:
        """Whether it writes assets of other readers, as new files."""
        return hasattr(self.reader, "write_new")

    @property
    def tells_names(self) -> bool:
        """Whether it tells what meshes are called in what it writes."""
        return hasattr(self.reader, "written_names")

    def write_new(self, asset: Asset, output: Path) -> None:
        """Let the reader write."""
        self.reader.write_new(asset, output)  # type: ignore[attr-defined]


def find_reader(source: str) -> SourceReader | None:
    """Return the first reader that accepts a source; None if there is none."""
    return next((reader for reader in _readers() if reader.accepts(source)), None)


def reader_called(name: str, parameters: Mapping[str, Any] | None = None) -> SourceReader:
    """Return the reader of a name, as `Asset.reader` has it.

    Raises
    ------
    UsageError
        If there is none.
    """
    return (
        UsdReader(**(parameters or {}))
        if name == READER
        else PluginReader(make_reader(name, **(parameters or {})), name)
    )


def new_writer(output: Path) -> PluginReader | None:
    """Return the first reader that can make a new file, or folder, of that name of any asset."""
    plugins = (reader for reader in _readers() if isinstance(reader, PluginReader))
    return next((each for each in plugins if each.writes_new and each.writes(output)), None)


def takes(source: str, parameters: Mapping[str, Any]) -> bool:
    """Tell whether the reader of a source takes all of some parameters."""
    reader = find_reader(source)
    if isinstance(reader, UsdReader):
        return parameters.keys() <= {each.name for each in fields(UsdReader)}
    if not isinstance(reader, PluginReader):
        return not parameters
    return parameters.keys() <= catalogue().find("reader", reader.name).record.parameters.keys()


def parameters_for(
    source: str, parameters: Mapping[str, Any], *, copy: bool = False
) -> dict[str, Any]:
    """Return those of some parameters that the reader of a source takes.

    Parameters
    ----------
    copy : bool
        Whether it is a copy of what they are for: that need not have such clips and variants.
    """
    taken = {name: value for name, value in parameters.items() if takes(source, {name: value})}
    loose = copy and taken and takes(source, {"strict": False})
    return {**taken, "strict": False} if loose else taken


def open_source(
    source: str, prims: Sequence[str] = (), parameters: Mapping[str, Any] | None = None
) -> Asset:
    """Read a source in this process; see `meshmark.read`."""
    reader = find_reader(source)
    if reader is not None and parameters:
        if not takes(source, parameters):
            told = " or ".join(parameters)
            raise UsageError(f"its reader takes no {told}", source=source)
        reader = reader_called(reader.name, parameters)
    if reader is not None:
        return reader.read(source, prims)
    if not Path(source).exists():
        raise InputError("no such file or folder", source=source)
    known = ", ".join(offer.name for offer in catalogue().of_kind("reader"))
    raise InputError(
        f"nothing here reads it: not USD, and none of the readers {known}", source=source
    )


def _readers() -> Iterator[SourceReader]:
    yield UsdReader()
    for offer in catalogue().of_kind("reader"):
        yield PluginReader(make_reader(offer.name), offer.name)


def files_named(source: str) -> list[Path]:
    """List the files of a folder, or those that a path or pattern names, sorted."""
    path = Path(source)
    if path.is_dir():
        return sorted(entry for entry in path.iterdir() if entry.is_file())
    # Path.glob takes no absolute patterns.
    return sorted(Path(name) for name in glob(source)) or [path]  # noqa: PTH207


def files_there(source: str) -> list[Path]:
    """List the files of a folder, or those there are of a path or pattern, folders below too."""
    path = Path(source)
    if path.is_dir():
        return [file for file in path.iterdir() if file.is_file()]
    return [path] if path.exists() else [Path(name) for name in glob(source, recursive=True)]  # noqa: PTH207
