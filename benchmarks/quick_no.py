"""What `verify` loses by giving up after its quick looks, and how often a random key leaves hope.

    python benchmarks/quick_no.py [--asset NAME]... [--keys 2] [--row PATTERN]... [-o FILE]

Marks the reference animations by a scheme with several keys, attacks the copies as suite `leaks`
does, and takes all looks that `verify --frames auto` may take until one says "marked". Appends a
line of JSON for each copy to FILE, leaves out those that are in it, and prints the tables of
docs/benchmarks/quick-no.md.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

import meshmark
from measuring import data_folder, table
from meshmark.benchmarking.cells import attack_copy
from meshmark.benchmarking.subjects import in_memory, select_frames
from meshmark.benchmarking.suite_rows import Cell
from meshmark.benchmarking.suites import SUITES
from meshmark.detection.decision import decide
from meshmark.detection.gathering import Survey
from meshmark.detection.looks import HOPE, LOOKS, QUICK
from meshmark.errors import MeshmarkError
from meshmark.extension.recipe import Recipe, recipe_from_text
from meshmark.keys import Key
from meshmark.mesh.asset import Asset

SOFT = ("bins=14", "width=0.06", "strength=0.5", "max_mrms=0.0006", "hold=3")
ASSETS: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "horse": ("horse-gallop.usdc", "1:24:2", ()),
    "cow": ("pcow.usdc", "1:48:4", SOFT),
    "dancer": ("samba.usdc", "1:24:2", ()),
}
# Of rows that any look finds, and of those that none does, a few are enough.
ROWS = (
    "unmarked",
    "no attack",
    "noise 0.50 %",
    "quantization 7 bit",
    "similarity*",
    "smoothing 30",
    "smoothing 50",
    "simplification 70 %",
    "simplification 90 %",
    "fast simplification*",
    "cropping*",
)
UNMARKED = Cell("none", {}, "animation", "unmarked", "none")
RANDOM_KEYS = 16
FPR = -6.0
# Numbers of the keys that copies are marked by, and of those that nobody has marked by.
OWNERS, STRANGERS = 1, 100


def key_of(number: int) -> Key:
    """Return one of 256 keys that everybody knows."""
    return Key(bytes([number]) * 32)


def looked_at(copy: Asset, recipe: Recipe, key: Key) -> list[list[float]]:
    """Take looks until one says "marked"; log10 of 1 / E of the key, then of random ones, each."""
    survey = Survey(copy, recipes=[recipe], frames="auto", jobs=1, progress=None)
    views = survey.extractions(survey.recipes)
    keys = [key, *map(key_of, range(STRANGERS, STRANGERS + RANDOM_KEYS))]
    found: list[list[float]] = []
    for look in LOOKS:
        items = survey.evidence(views, look)
        told = [decide("", items, each, share=look.share) for each in keys]
        found.append([min(verdict.hope, 99.0) for verdict in told])
        if told[0].verdict == "marked":
            break
    return found


def measured(name: str, number: int, options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Mark an asset by a key, attack the copy, and look at it; row by row."""
    file, frames, settings = ASSETS[name]
    recipe = recipe_from_text(options.scheme, settings=settings if options.scheme == "apex" else ())
    asset = select_frames(meshmark.read(data_folder() / file), frames)
    marked = None
    for cell in (UNMARKED, *SUITES["leaks"].cells):
        row = {"asset": name, "key": number, "attack": cell.label, "per": cell.per}
        asked = any(fnmatchcase(cell.label, pattern) for pattern in options.row or ROWS)
        if row in options.known or not asked:
            continue
        if cell is not UNMARKED and marked is None:
            marked = meshmark.embed(asset, key_of(number), recipe=recipe).asset
        copy = asset if marked is None else attacked(marked, cell, number)
        yield {**row, "looks": looked_at(copy, recipe, key_of(number))}


def attacked(asset: Asset, cell: Cell, seed: int) -> Asset:
    """Attack a copy, and let its numbers be those of a file."""
    return in_memory(attack_copy(replace(asset, source="copy"), cell, seed, ()), stored=True)


def is_given_up(hopes: list[float]) -> bool:
    """Tell whether the quick looks decide nothing, and leave no hope."""
    return len(hopes) >= len(QUICK) and min(hopes[: len(QUICK)]) > HOPE


def is_found(hopes: list[float]) -> bool:
    """Tell whether the last look that was taken says "marked"."""
    return bool(hopes[-1] - np.log10(LOOKS[len(hopes) - 1].share) <= FPR)


def line_of(row: dict[str, Any]) -> list[object]:
    """Tell of a copy that the first look does not decide."""
    hopes = [look[0] for look in row["looks"]]
    cells = [f"{hope:.1f}" for hope in hopes] + ["-"] * (len(LOOKS) - len(hopes))
    answers = ["no" if is_given_up(hopes) else "yes", "yes" if is_found(hopes) else "no"]
    return [row["asset"], row["key"], f"{row['attack']}, per {row['per']}", *cells, *answers]


def report(rows: list[dict[str, Any]]) -> str:
    """Count what is found and lost, and lay out the table."""
    owners = [[look[0] for look in row["looks"]] for row in rows]
    found = [hopes for hopes in owners if is_found(hopes)]
    lost = sum(map(is_given_up, found))
    quick = [np.array(row["looks"])[: len(QUICK), 1:] for row in rows]
    strangers = np.concatenate([each.min(axis=0) for each in quick if len(each) == len(QUICK)])
    hopeful = 100 * np.mean(strangers <= HOPE)
    looks = [f"{look.frames or 'all'}, {look.restored}" for look in LOOKS]
    head = ["animation", "key", "attack", *looks, "hope", "found"]
    return (
        f"{len(rows)} copies, {len(found)} found, {lost} of them lost by giving up; "
        f"{len(strangers)} random keys, {hopeful:.1f} % of them leave hope\n\n"
        + table(head, [line_of(row) for row in rows if len(row["looks"]) > 1])
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--asset", action="append", choices=ASSETS)
    parser.add_argument("--scheme", default="apex")
    parser.add_argument("--keys", type=int, default=2)
    parser.add_argument("--row", action="append", help="row of suite leaks; * stands for anything")
    parser.add_argument("-o", "--output", type=Path, default=Path("quick-no.jsonl"))
    options = parser.parse_args()
    rows = []
    if options.output.exists():
        rows = [json.loads(line) for line in options.output.read_text("ascii").splitlines()]
    options.known = [{k: v for k, v in row.items() if k != "looks"} for row in rows]
    for number in range(OWNERS, OWNERS + options.keys):
        for name in options.asset or ASSETS:
            try:
                for row in measured(name, number, options):
                    rows.append(row)
                    with options.output.open("a", encoding="ascii") as file:
                        file.write(json.dumps(row) + "\n")
            except MeshmarkError as error:
                print(f"{name}: {error}")
    print(report(sorted(rows, key=lambda row: (list(ASSETS).index(row["asset"]), row["key"]))))


if __name__ == "__main__":
    main()
