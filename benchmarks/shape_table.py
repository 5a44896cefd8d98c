"""Writes the table of docs/benchmarks/informed.md: relief on shapes that hold no blind mark.

usage: python benchmarks/shape_table.py

Every shape is marked by `relief` with its defaults, attacked, and verified beside its original.
In brackets stands what the unmarked shape says after the same attack.
"""

from __future__ import annotations

from collections.abc import Callable

from measuring import data_folder
from meshmark.commands.attack import attack_asset
from meshmark.delivery.unmarked import split_fit
from meshmark.detection.verify import verify
from meshmark.embedding.asset import embed
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import make_attack
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.sources.reading import read
from meshmark.testing.meshes import Mesh, icosphere, plane

KEY, RELIEF = Key(bytes(range(32))), [Recipe("relief")]
SEEDS = 3
ATTACKS = {
    "similarity": make_attack("similarity"),
    "noise 0.05 %": make_attack("noise", amplitude=0.0005),
    "simplification 30 %": make_attack("simplification", ratio=0.3),
    "cropping 30 %": make_attack("cropping", share=0.3),
}


def stored(name: str) -> Callable[[], Asset]:
    """Return what reads a reference asset."""
    return lambda: split_fit(read(data_folder() / "usd" / name))


def built(build: Callable[[], Mesh]) -> Callable[[], Asset]:
    """Return what makes an asset of a mesh."""
    return lambda: as_asset(MeshAnimation.from_arrays(*build(), prim="/Shape"))


def eye() -> Mesh:
    """Build a ball whose three axes differ."""
    V, F = icosphere(4)
    return V * (1.0, 0.95, 0.9), F


SHAPES = {
    "sphere, `points-sphere.usda`": stored("points-sphere.usda"),
    "ball, `ballset`": stored("ballset/StandaloneScene/Ball_payload.usd"),
    "human, `skel-human.usda`": stored("skel-human.usda"),
    "plane": built(lambda: plane(50)),
    "ellipsoid 1 : 0.95 : 0.9": built(eye),
}


def told(copy: Asset, original: Asset) -> str:
    """Say what a copy says: log10 p, or that nothing can be said."""
    verdict = verify(copy, KEY, recipes=RELIEF, original=original)
    return verdict.verdict if verdict.verdict == "inconclusive" else f"{verdict.log10_p:.1f}"


def main() -> None:
    """Print the table."""
    print(f"| shape | points | no attack | {' | '.join(ATTACKS)} |")
    print(f"|{'---|' * (3 + len(ATTACKS))}")
    for name, make in SHAPES.items():
        original = make()
        marked = embed(original, KEY, recipe=RELIEF).asset
        points = max(mesh[0].topology.n_points for mesh in original.meshes)
        cells = [f"{told(marked, original)} ({told(original, original)})"]
        for attack in ATTACKS.values():
            pairs = [
                [told(attack_asset(side, attack, seed), original) for side in (marked, original)]
                for seed in range(SEEDS)
            ]
            cells.append(", ".join(f"{ours} ({control})" for ours, control in pairs))
        print(f"| {name} | {points:,} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
