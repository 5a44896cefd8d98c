"""Reads a source in a process of its own, and outlives whatever that does to it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from meshmark.errors import InputError
from meshmark.files.temporary import ScratchFolder
from meshmark.mesh.asset import Asset
from meshmark.sources.isolation.limits import MEMORY_VARIABLE
from meshmark.sources.isolation.process import ARRAYS, PROGRAM, WITH_TEXTURES, WITHOUT, started
from meshmark.sources.isolation.report import asset_from, error_from

# What a report raises that does not fit.
NONSENSE = (AttributeError, LookupError, TypeError, ValueError, OverflowError, RecursionError)


def read_isolated(
    source: str | Path,
    prims: Sequence[str] = (),
    *,
    parameters: Mapping[str, Any] | None = None,
    textures: bool = False,
) -> Asset:
    """Read a source as `meshmark.read` does, in a process of its own that is given limits.

    A file made to crash or to hang a library takes that process with it, and nothing else. All
    frames are read, once, into a temporary file; the asset reads them from there.

    Parameters
    ----------
    source, prims, parameters
        As `meshmark.read` takes them.
    textures : bool
        Read texture coordinates, too.

    Returns
    -------
    Asset
        Its `facts` tell the files it was read from. The temporary file lives as long as the
        asset, its meshes or anything made of them.

    Raises
    ------
    InputError
        As `meshmark.read`; or if reading crashes, needs more memory or time than it is given, or
        if the source changes meanwhile.
    UsageError
        If a wanted mesh is not in it, or a limit makes no sense.
    """
    asked = WITH_TEXTURES if textures else WITHOUT
    given = json.dumps(dict(parameters or {}))
    with isolated(PROGRAM, str(source), asked, given, *prims) as (report, folder):
        return asset_from(report, str(source), folder.path / ARRAYS, folder)


@contextmanager
def isolated(
    program: str, source: str, *arguments: str
) -> Iterator[tuple[dict[str, Any], ScratchFolder]]:
    """Let a process of its own work on a source within limits; give its report and its folder.

    The program is a module that lets `child.Child` run. The block is to make sense of the report;
    the folder is gone if it does not, and otherwise when nobody has it.

    Raises
    ------
    InputError, UsageError
        See `read_isolated`.
    """
    process = started(program, source, *arguments)
    try:
        report = process.report()
        _require_done(report, source)
        yield report, process.folder
    except NONSENSE as error:
        process.folder.remove()
        raise InputError(f"reading it goes astray: {error}", source=source) from None
    except BaseException:
        process.folder.remove()
        raise


def _require_done(report: dict[str, Any], source: str) -> None:
    """Raise what the process raised."""
    if "error" in report:
        raise error_from(report["error"])
    if "memory" in report:
        raise InputError(
            f"needs more than {report['memory']:g} GB of memory to read; {MEMORY_VARIABLE} can "
            "allow more",
            source=source,
        )
    if "bug" in report:
        bug = RuntimeError(f"{report['bug']} (while {source} was read)")
        bug.add_note(str(report["traceback"]))
        raise bug
