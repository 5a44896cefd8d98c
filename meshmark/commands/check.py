"""Looks at a file that is to leave the house, or has left it, and at what was marked before."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from meshmark.embedding.upkeep import stale, told_of, unmarked_frames
from meshmark.errors import InputError
from meshmark.mesh.asset import Asset
from meshmark.sources.isolation.reading import isolated
from meshmark.sources.reading import read
from meshmark.usd.findings import Finding
from meshmark.usd.names import STAGE_SUFFIXES
from meshmark.usd.reader import UsdReader


def check_file(file: str | Path, *, trusted: bool = False) -> dict[str, Any]:
    """List what a stage gives away, as a deliverable must not, and what is wrong with its marks.

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
        seen = _look(name)
    else:
        with isolated(__name__, name) as (report, _):
            seen = {"findings": list(report["findings"]), "meshes": bool(report["meshes"])}
    found = seen["findings"]
    if seen["meshes"]:
        found += map(asdict, unmarkable_in(name, trusted=trusted))
    return {"file": name, "findings": sorted(found, key=lambda each: tuple(each.values()))}


def given_away(file: str, beat: Callable[[], None] = lambda: None) -> list[Finding]:
    """List what a stage gives away; see `meshmark.usd.checking`."""
    from meshmark.usd.checking import check_stage

    told = told_of(Path(file))
    return check_stage(file, told.marked, told.stamps, beat)


def stale_in(file: str, beat: Callable[[], None] = lambda: None) -> list[Finding]:
    """List the marked files a stage is made of whose sources are not what was marked."""
    return [each for path in UsdReader().files(file) for each in stale(path, beat)]


def unmarked_frames_in(file: str) -> list[Finding]:
    """List the marked meshes of a stage of which some frames hold no mark."""
    from meshmark.usd.checking import frames_without_mark

    files = UsdReader().files(file)
    marked = {prim for path in files for prim in told_of(path).marked}
    told = [each for path in files for each in unmarked_frames(path)]
    return [*told, *frames_without_mark(file, marked)]


def unmarkable_in(file: str, *, trusted: bool = True) -> list[Finding]:
    """List the meshes of a stage that can hold no mark of the default layers.

    Those that its manifest says are marked, or are not, are known.
    """
    told = told_of(Path(file))
    known = {*told.marked, *told.skipped}
    try:
        asset = read(file, isolated=not trusted)
    except InputError as error:
        if error.prim is None:
            raise
        return [] if error.prim in known else [Finding("unmarkable", error.prim, error.message)]
    return list(_unmarkable(asset, known))


def _unmarkable(asset: Asset, known: set[str]) -> Iterable[Finding]:
    # A process that only looks has no use for schemes.
    from meshmark.commands.inspect import why_not

    for each in asset.left_out:
        if not each.guide and each.prim not in known:
            yield Finding("unmarkable", each.prim, each.reason)
    for mesh in asset.meshes:
        reason = None if mesh.prim in known else why_not(mesh)
        if reason is not None:
            yield Finding("unmarkable", mesh.prim, reason)


def _look(file: str, beat: Callable[[], None] = lambda: None) -> dict[str, Any]:
    from meshmark.usd.checking import has_meshes

    found = [*given_away(file, beat), *stale_in(file, beat), *unmarked_frames_in(file)]
    return {"findings": [asdict(each) for each in found], "meshes": has_meshes(file)}


if __name__ == "__main__":
    from meshmark.sources.isolation.child import Child

    child = Child(Path(sys.argv[1]), sys.argv[2])
    child.run(lambda: _look(child.source, child.beat))
