"""Writes the table of docs/formats.md: marks on cages, by what a leak shows of their surfaces.

usage: python benchmarks/subdivision_table.py FILE|creature...

The first mesh of each file, or the demonstration's creature of 3000 points, is marked by `relief`
in twelve frames. The marked cage is subdivided, and verified beside the original's cage.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from meshmark.demo import creature
from meshmark.detection.verify import verify
from meshmark.embedding.asset import embed
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import make_attack
from meshmark.keys import Key
from meshmark.mesh.asset import Asset, as_asset
from meshmark.sources.reading import read

FRAMES = 12
POINTS = 3000
COPIES = {
    "level 1": {"steps": 1},
    "level 2": {"steps": 2},
    "limit, at level 1": {"steps": 1, "limit": True},
    "limit, at level 2": {"steps": 2, "limit": True},
}


def subject(name: str) -> Asset:
    """Read the first mesh of a file, or make the creature; some frames, spread evenly."""
    asset = as_asset(creature(POINTS)) if name == "creature" else read(name)
    mesh = asset.meshes[0]
    some = np.linspace(0, len(mesh) - 1, min(FRAMES, len(mesh))).round().astype(int)
    return replace(asset, meshes=(mesh.select(some.tolist()),))


def main(names: list[str]) -> None:
    """Print the table."""
    print(f"| cage, rule | points | cage | {' | '.join(COPIES)} |")
    print(f"|{'---|' * (3 + len(COPIES))}")
    key, relief = Key(bytes(range(32))), Recipe("relief")
    for name in names:
        original = subject(name)
        marked = embed(original, key, recipe=relief).asset
        for rule in ("catmull_clark", "loop"):
            found = [marked]
            for parameters in COPIES.values():
                attack = make_attack("subdivision", scheme=rule, **parameters)
                copy = attack.apply(marked.meshes[0], np.random.default_rng(0))
                found.append(replace(original, meshes=(copy,)))
            told = [
                f"{verify(copy, key, recipes=[relief], original=original).log10_p:.1f}"
                for copy in found
            ]
            label = name.rpartition("/")[2]
            points = original.meshes[0][0].topology.n_points
            print(f"| `{label}`, `{rule}` | {points} | {' | '.join(told)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
