"""A marked asset out, and back in: who writes it, and under which names."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshmark.errors import UsageError
from meshmark.extension.interfaces import SourceReader
from meshmark.mesh.asset import Asset
from meshmark.sources.readers import (
    PluginReader,
    new_writer,
    open_source,
    reader_called,
    takes,
)
from meshmark.usd.names import BAKE, FOLLOW, LAYER_SUFFIXES
from meshmark.usd.reader import UsdReader

if TYPE_CHECKING:
    from meshmark.usd.delivery import Delivery
    from meshmark.usd.writing import Override


def write(
    marked: Asset,
    original: Asset,
    output: str | Path,
    *,
    parameters: Mapping[str, Any] | None = None,
    deliver: bool = False,
) -> None:
    """Write a marked asset beside its original.

    Parameters
    ----------
    marked : Asset
        The marked meshes; those of `original` that are missing here stay as they are.
    original : Asset
        As it was read.
    output : str or Path
        A USD layer: an override that sublayers a USD source, or a whole stage for any other.
        Or what the original's own reader writes, such as a folder of OBJ frames; or a new .glb.
    parameters : mapping, optional
        Of the original's reader, as `meshmark.read` was given them.
    deliver : bool
        Flatten into one file in which no unmarked point is left.

    Raises
    ------
    UsageError
        If the output's kind does not fit the source, or it cannot be written back.
    OutputError
        If it cannot be written; nothing half-written is left.
    """
    writer(original, output, parameters=parameters, deliver=deliver)(marked)


def writer(
    original: Asset,
    output: str | Path,
    *,
    parameters: Mapping[str, Any] | None = None,
    deliver: bool = False,
    keep_metadata: bool = False,
    skel: str = BAKE,
    primvars: str = FOLLOW,
) -> Callable[..., Delivery | Override | None]:
    """Return what `write` would call with the marked asset, so that a bad output is known early.

    Where it writes USD, it also takes `stamps`; see `meshmark.usd.stamp`. What it returns is for
    the manifest.

    Raises
    ------
    UsageError
        If the output's kind does not fit the source, or it cannot be written back.
    """
    path, usd = Path(output), UsdReader()
    if deliver and usd.writes(path):
        return partial(
            usd.deliver,
            original=original,
            output=path,
            keep_metadata=keep_metadata,
            skel=skel,
            primvars=primvars,
        )
    if usd.writes(path):
        return partial(usd.lay, original=original, output=path, skel=skel, primvars=primvars)
    reader = reader_called(original.reader, parameters)
    if reader.writes(path):
        reader.require_writable(original.source, path)
        return partial(reader.write, original=original, output=path)
    other = new_writer(path)
    if other is not None and other.tells_names:
        return partial(_write_new, reader=other, original=original, output=path)
    raise UsageError(
        f"the {original.reader} reader cannot write to {str(output)!r}; "
        f"{', '.join(LAYER_SUFFIXES)} always can be"
    )


def written_names(original: Asset, output: str | Path) -> dict[str, str]:
    """Map the name of each mesh of an asset to its name in what `write` makes of it.

    A source that is no stage may hold names that are no prim paths.
    """
    return _writing_reader(original, Path(output)).written_names(original)


def read_back(
    original: Asset,
    output: str | Path,
    prims: Sequence[str],
    parameters: Mapping[str, Any] | None = None,
) -> Asset:
    """Read meshes of an asset from where `write` put them, under the names they came with.

    Raises
    ------
    InputError
        If what was written cannot be read.
    """
    names = written_names(original, output)
    # A layer over a stage selects variants itself, and a new stage has none.
    own = not UsdReader().writes(Path(output)) and takes(str(output), parameters or {})
    given = parameters if own else None
    written = open_source(str(output), [names[prim] for prim in prims], given)
    named = zip(written.meshes, prims, strict=True)
    return replace(written, meshes=tuple(replace(mesh, prim=prim) for mesh, prim in named))


def _write_new(marked: Asset, *, reader: PluginReader, original: Asset, output: Path) -> None:
    reader.write_new(original.with_meshes(marked.meshes), output)


def _writing_reader(original: Asset, output: Path) -> SourceReader:
    for reader in (UsdReader(), reader_called(original.reader)):
        if reader.writes(output):
            return reader
    return new_writer(output) or reader_called(original.reader)
