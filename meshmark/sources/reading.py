"""A source in: read by this process, or by one of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from meshmark.files.reading import require_no_device
from meshmark.mesh.asset import Asset
from meshmark.sources.isolation.reading import read_isolated
from meshmark.sources.readers import open_source


def read(
    source: str | Path,
    prims: Sequence[str] = (),
    *,
    parameters: Mapping[str, Any] | None = None,
    isolated: bool = False,
) -> Asset:
    """Read every mesh of a USD file, a folder or glob of OBJ frames, or a glTF file.

    Parameters
    ----------
    source : str or Path
        What to read.
    prims : sequence of str
        Paths of the meshes wanted; all where empty.
    parameters : mapping, optional
        Of the reader: of glTF, `clip`, the name of an animation, and `fps`; of USD, `variants`, a
        sequence of `SET=NAME` or `PRIM{SET=NAME}`.
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
        If a wanted mesh or clip is not in it, or its reader takes no such parameter.
    """
    name = str(source)
    require_no_device(Path(name))
    if isolated:
        return read_isolated(name, prims, parameters=parameters)
    return open_source(name, prims, parameters)
