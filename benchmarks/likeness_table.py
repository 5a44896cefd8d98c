"""Writes the table of docs/ledger.md: how often an original is among the first that are tried.

usage: python benchmarks/likeness_table.py [FILE...]

A hundred originals are rocks, balls with waves of their own. Or, if files are named, they are the
largest meshes of these in turn, of about 3000 points in the first frame, stretched and bent anew.
Of every fifth a copy is attacked, and the originals are ranked by `identify`'s likeness.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from meshmark.alignment.likeness import hypotheses, signatures, unlikeness
from meshmark.extension.registry import make_attack
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.sources.reading import read
from meshmark.testing.meshes import icosphere
from meshmark.workers.pool import one_thread

ORIGINALS, POINTS = 100, 3000
SUSPECTS = range(2, ORIGINALS, 5)
FIRST = (1, 4, 8)
MOVED = ("similarity", {})
NOISE = ("noise", {"amplitude": 0.001})
HALF = ("simplification", {"ratio": 0.5})
ATTACKS: dict[str, list[tuple[str, dict[str, Any]]]] = {
    "noise 0.1 %": [NOISE],
    "simplification 50 %": [HALF],
    "simplification 90 %": [("simplification", {"ratio": 0.9})],
    **{
        f"cropping {share:.0%}, moved": [("cropping", {"share": share}), MOVED]
        for share in (0.1, 0.2, 0.5)
    },
    **{
        f"cropping {share:.0%}, simplification 50 %, noise 0.1 %, moved": [
            ("cropping", {"share": share}),
            HALF,
            NOISE,
            MOVED,
        ]
        for share in (0.2, 0.5)
    },
}


def rock(seed: int) -> MeshAnimation:
    """Raise and lower a ball of 2562 points by waves."""
    V, F = icosphere(4)
    rng = np.random.default_rng(seed)
    waves = [
        0.12 * rng.normal() * np.sin(3 * V @ rng.normal(size=3) + rng.uniform(0, 6))
        for _ in range(8)
    ]
    return MeshAnimation.from_arrays(V * (1 + sum(waves))[:, None], F, prim="/Rock")


def body(bases: list[MeshAnimation], seed: int) -> MeshAnimation:
    """Stretch and bend one of some meshes, as another sculptor would have made it."""
    frame = bases[seed % len(bases)][0]
    rng = np.random.default_rng(seed)
    diagonal = np.linalg.norm(np.ptp(frame.points, axis=0))
    X = (frame.points - frame.points.mean(axis=0)) / diagonal * rng.uniform(0.85, 1.18, 3)
    for _ in range(6):
        wave, move = 6.0 * rng.normal(size=3), 0.015 * rng.normal(size=3)
        X = X + move * np.sin(X @ wave + rng.uniform(0, 6))[:, None]
    return MeshAnimation.from_arrays(diagonal * X, frame.faces, prim="/Body")


def base(name: str) -> MeshAnimation:
    """Read the largest mesh of a file, its first frame, in few points."""
    frame = max((mesh[0] for mesh in read(name).meshes), key=lambda each: each.topology.n_points)
    still = MeshAnimation.from_arrays(frame.points, frame.faces, prim="/Base")
    more = 1.0 - POINTS / frame.topology.n_points
    return attacked(still, [("simplification", {"ratio": more})], 0) if more > 0.05 else still


def attacked(
    mesh: MeshAnimation, attacks: list[tuple[str, dict[str, Any]]], seed: int
) -> MeshAnimation:
    rng = np.random.default_rng(seed)
    for name, parameters in attacks:
        mesh = make_attack(name, **parameters).apply(mesh, rng)
    return mesh


def main(names: list[str]) -> None:
    """Print the table, and CPU seconds."""
    make: Callable[[int], MeshAnimation] = rock
    if names:
        make = partial(body, [base(name) for name in names])
    originals = [make(seed) for seed in range(ORIGINALS)]
    start = time.process_time()
    known = [signatures(as_asset(original)) for original in originals]
    print(f"measuring an original: {(time.process_time() - start) / ORIGINALS:.3f} s\n")
    print(f"| attack | {' | '.join(f'first {n}' for n in FIRST)} |\n|{'---|' * (1 + len(FIRST))}")
    spent, n = 0.0, 0
    for name, attacks in ATTACKS.items():
        ranks = []
        for seed in SUSPECTS:
            copy = as_asset(attacked(originals[seed], attacks, seed))
            start = time.process_time()
            mine = hypotheses(copy)
            unlike = np.array([unlikeness(mine, each) for each in known])
            spent, n = spent + time.process_time() - start, n + 1
            ranks.append(int((unlike < unlike[seed]).sum()))
        shares = [f"{np.mean(np.array(ranks) < first):.0%}" for first in FIRST]
        print(f"| {name} | {' | '.join(shares)} |", flush=True)
    print(f"\nranking {ORIGINALS} by one suspect: {spent / n:.2f} s")


if __name__ == "__main__":
    with one_thread():
        main(sys.argv[1:])
