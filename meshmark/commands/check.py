"""Looks at a file that is to leave the house, or has left it, from outside."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from meshmark.embedding.description import stamps_told
from meshmark.embedding.manifest import manifest_path
from meshmark.errors import InputError
from meshmark.sources.isolation.reading import isolated
from meshmark.usd.names import STAGE_SUFFIXES
from meshmark.usd.reader import UsdReader
from meshmark.usd.stamp import Stamp


def check_file(file: str | Path, *, trusted: bool = False) -> dict[str, Any]:
    """List what a deliverable gives away: shapes, layers, paths and words.

    Unless it is trusted, a process of its own looks at it, which it could crash or hang.

    Where its manifest lies beside it, the meshes that this says are marked may resemble each
    other, and have the stamps that it tells of.

    Returns
    -------
    dict
        JSON values, as `check --json` prints them; the schema is
        `schemas/json/check.schema.json`.

    Raises
    ------
    InputError
        If it cannot be read, or is no stage.
    """
    name = str(file)
    if not UsdReader().accepts(name):
        raise InputError(f"only {', '.join(STAGE_SUFFIXES)} can be checked", source=name)
    if not Path(name).is_file():
        raise InputError("no such file", source=name)
    if trusted:
        return {"file": name, "findings": _findings(name)}
    with isolated(__name__, name) as (report, _):
        return {"file": name, "findings": list(report["findings"])}


def _findings(file: str, beat: Callable[[], None] = lambda: None) -> list[dict[str, str]]:
    from meshmark.usd.checking import check_stage

    told = _told(Path(file))
    return [asdict(each) for each in check_stage(file, *told, beat)]


def _told(file: Path) -> tuple[list[str], list[Stamp]]:
    """Read in the manifest which meshes are marked, and which stamps they have."""
    path = manifest_path(file)
    if not path.is_file():
        return [], []
    try:
        document = json.loads(path.read_text())
        prims = document["prims"]
        return [str(each["prim"]) for each in prims], list(stamps_told(document).values())
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"is no manifest: {error}", source=path) from None


if __name__ == "__main__":
    from meshmark.sources.isolation.child import Child

    child = Child(Path(sys.argv[1]), sys.argv[2])
    child.run(lambda: {"findings": _findings(child.source, child.beat)})
