"""A source in: read by this process, or by one of its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from meshmark.files.reading import require_no_device
from meshmark.mesh.asset import Asset
from meshmark.sources.isolation.reading import read_isolated
from meshmark.sources.readers import open_source


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
    return read_isolated(name, prims) if isolated else open_source(name, prims)
