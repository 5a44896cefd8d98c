"""How often a random key finds a mark: in every mesh and part of a source, as `verify` judges them.

    python benchmarks/false_positives.py marked.usdc unmarked.usdc --keys 100000 -o FOLDER

Writes `false-positives.png`, the share of keys whose p is at most a against a, and prints the
table that goes with it. A p-value is valid if no curve lies above the diagonal.
"""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import meshmark
from meshmark.arrays import FloatArray
from meshmark.detection.decision import pooled, shares
from meshmark.detection.evidence import Evidence
from meshmark.detection.gathering import gather
from meshmark.detection.significance import log10_p_of
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.workers.ordered_map import default_jobs, ordered_map

AT_ONCE = 500
LEVELS = (-1.0, -2.0, -3.0, -4.0, -6.0)


@dataclass(frozen=True)
class TryKeys:
    """Tries a block of keys, numbered and the same in every run, on evidence of one scheme."""

    items: tuple[Evidence, ...]

    def __call__(self, block: int) -> FloatArray:
        numbers = range(block * AT_ONCE, (block + 1) * AT_ONCE)
        keys = [Key(hashlib.sha256(f"false positives {n}".encode()).digest()) for n in numbers]
        words = np.array([self.items[0].words(key, None) for key in keys])
        paid = [
            log10_p_of(item, words) - share
            for item, share in zip(self.items, shares(self.items), strict=True)
        ]
        paid += [pool.log10_p(words) - share for pool, share in pooled(self.items)]
        return np.minimum(0.0, np.min(paid, axis=0))


def try_keys(source: str, options: argparse.Namespace) -> tuple[int, FloatArray]:
    """Return of how many parts a source is, and log10 p of many keys on them all."""
    found = gather(
        meshmark.read(source),
        recipes=[Recipe(options.scheme)],
        frames=options.frames,
        restored=not options.plain,
        jobs=default_jobs(),
    )
    blocks = range(-(-options.keys // AT_ONCE))
    log10_p = list(ordered_map(TryKeys(found.items), blocks, jobs=default_jobs()))
    return len(found.items), np.concatenate(log10_p)[: options.keys]


def draw(results: dict[str, FloatArray], path: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 4.5), dpi=110)
    for name, log10_p in results.items():
        ordered = np.sort(log10_p)
        share = np.arange(1, len(ordered) + 1) / len(ordered)
        axes.step(10**ordered, share, where="post", label=name)
    axes.plot([1e-6, 1], [1e-6, 1], color="0.6", linestyle=":", label="largest valid share")
    axes.set(xscale="log", yscale="log", xlim=(1e-6, 1), ylim=(5e-6, 1.5))
    axes.set(xlabel="a", ylabel="share of random keys with p at most a")
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sources", nargs="+")
    parser.add_argument("--keys", type=int, default=100_000)
    parser.add_argument("--scheme", default="apex")
    parser.add_argument("--frames", default=":", help="range A:B[:S] of time codes")
    parser.add_argument("--plain", action="store_true", help="leave out undone smoothing")
    parser.add_argument("-o", "--output", type=Path, default=Path())
    options = parser.parse_args()
    results: dict[str, FloatArray] = {}
    heads = " | ".join(f"p <= 1e{level:g}" for level in LEVELS)
    print(f"| source | parts | {heads} | lowest log10 p |")
    print("| --- |" + " --- |" * (len(LEVELS) + 2))
    for source in options.sources:
        parts, log10_p = try_keys(source, options)
        counts = " | ".join(str(int(np.count_nonzero(log10_p <= level))) for level in LEVELS)
        print(f"| {Path(source).stem} | {parts} | {counts} | {log10_p.min():.2f} |", flush=True)
        results[Path(source).stem] = log10_p
    draw(results, options.output / "false-positives.png")


if __name__ == "__main__":
    main()
