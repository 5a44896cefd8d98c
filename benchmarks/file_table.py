"""Writes the table of docs/formats.md: what `meshmark inspect` says of files.

usage: python benchmarks/file_table.py FOLDER_OR_FILE...

Of folders, all files of USD and glTF are looked at. A file whose rows would be those of the file
before it shares its row.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from meshmark.commands.inspect import inspect_asset
from meshmark.errors import MeshmarkError
from meshmark.extension.defaults import DEFAULT_LAYERS
from meshmark.sources.reading import read

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz", ".glb", ".gltf")
HEAD = ("file", "meshes", "points", "frames", "times", "rigged", *DEFAULT_LAYERS)


def files_of(names: Iterable[str]) -> list[tuple[Path, str]]:
    """List files, and what to call them."""
    found = []
    for path in map(Path, names):
        below = sorted(each for each in path.rglob("*") if each.suffix in SUFFIXES)
        found += [(each, each.relative_to(path).as_posix()) for each in below if path.is_dir()]
        found += [(path, path.name)] if path.is_file() else []
    return found


def told(values: Iterable[Any]) -> str:
    """Spell what is the same for all meshes once, and else the smallest and the largest."""
    different = sorted(set(values))
    return " to ".join(dict.fromkeys((str(different[0]), str(different[-1]))))


def held(prims: list[dict[str, Any]], layer: int, scheme: str) -> str:
    """Say how many of some meshes can hold the mark of a layer, or why none can."""
    tried = [prim["layers"][layer] for prim in prims if prim["layers"]]
    able = [each for each in tried if each["can_hold"]]
    if len(able) == len(prims):
        return "yes"
    if able:
        return f"{len(able)} of {len(prims)}"
    reasons = [each["reason"] for each in tried] or [prim["reason"] for prim in prims]
    return "no: " + re.split("[,;:] ", reasons[0])[0]


def cells(file: Path) -> list[str]:
    """Return what is said of one file."""
    try:
        document = inspect_asset(read(file))
    except MeshmarkError as error:
        return [re.sub(" @[^@]*@", "", error.message.partition(". ")[0])]
    prims = document["prims"]
    times = [f"{a:g} to {b:g}" for a, b in (prim["times"] for prim in prims if prim["times"])]
    notes = [note for prim in prims for note in prim["notes"] if note.startswith("rigged")]
    places = any(prim["places"] < prim["points"] for prim in prims)
    points = told(prim["points"] for prim in prims)
    if places:
        points += f" at {told(prim['places'] for prim in prims)} places"
    return [
        str(len(prims)),
        points,
        told(prim["frames"] for prim in prims),
        "; ".join(dict.fromkeys(times)) or "none",
        f"{len(notes)}" if 0 < len(notes) < len(prims) else ("yes" if notes else "no"),
        *(held(prims, layer, scheme) for layer, scheme in enumerate(DEFAULT_LAYERS)),
    ]


def main(names: list[str]) -> None:
    """Print the table."""
    print(f"| {' | '.join(HEAD)} |")
    print(f"|{'---|' * len(HEAD)}")
    rows: dict[tuple[str, ...], list[str]] = {}
    for file, name in files_of(names):
        rows.setdefault(tuple(cells(file)), []).append(f"`{name}`")
    for found, alike in rows.items():
        blank = [""] * (len(HEAD) - 1 - len(found))
        print(f"| {' | '.join((', '.join(alike), *found, *blank))} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
