"""How often a random key finds a mark: in every mesh and part of a source, as `verify` judges them.

    python benchmarks/false_positives.py marked.usdc unmarked.usdc --keys 100000 -o FOLDER
    python benchmarks/false_positives.py --store FOLDER --keys 100000 -o FOLDER

Of a store, all that `verify --store` kept there is tried, by the scheme that is asked for. With
`--up-to 1e-3`, p is told of keys only where it is at most that: a quick bound, the one that
`identify` uses, leaves out most of the others, and they count as 1.

Writes `false-positives.png`, the share of keys whose p is at most a against a, and prints the
table that goes with it. A p-value is valid if no curve lies above the diagonal.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path

import numpy as np

import meshmark
from meshmark.arrays import FloatArray, IntArray
from meshmark.detection.decision import pooled, shares
from meshmark.detection.evidence import Evidence
from meshmark.detection.evidence_store import EvidenceStore, rows
from meshmark.detection.gathering import AssetEvidence, gather
from meshmark.detection.key_screen import KeyScreen, KeyWords
from meshmark.detection.significance import log10_p_of
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key, octets_of_keys, words_of_keys
from meshmark.workers.ordered_map import default_jobs, ordered_map

AT_ONCE = 2_000
LEVELS = (-1.0, -2.0, -3.0, -4.0, -6.0)


@dataclass(frozen=True)
class TryKeys:
    """Tries a block of keys, numbered and the same in every run, on evidence of one scheme."""

    items: tuple[Evidence, ...]
    up_to: float

    def __call__(self, block: int) -> FloatArray:
        numbers = range(block * AT_ONCE, (block + 1) * AT_ONCE)
        keys = [Key(hashlib.sha256(f"false positives {n}".encode()).digest()) for n in numbers]
        left = self._fit(keys) if self.up_to < 1.0 else np.arange(len(keys))
        log10_p = np.zeros(len(keys))
        if len(left):
            log10_p[left] = self._log10_p([keys[n] for n in left.tolist()])
        return log10_p

    def _fit(self, keys: list[Key]) -> IntArray:
        words = {}
        for scheme, needed in self._screen.needed.items():
            octets = octets_of_keys(keys, scheme, needed.numbers.tolist(), needed.n_chips)
            words[scheme] = KeyWords(needed.numbers, octets[:, 0])
        return np.flatnonzero(self._screen.may_be_found(words, len(keys)))

    @cached_property
    def _screen(self) -> KeyScreen:
        evidence = AssetEvidence("", self.items, n_schemes=1, notes=(), elapsed_s=0.0)
        return KeyScreen(evidence, 1, self.up_to, AT_ONCE)

    def _log10_p(self, keys: list[Key]) -> FloatArray:
        first = self.items[0]
        words = words_of_keys(keys, first.scheme, range(first.n_words), first.n_chips)[:, 0]
        paid = [
            log10_p_of(item, words) - share
            for item, share in zip(self.items, shares(self.items), strict=True)
        ]
        paid += [pool.log10_p(words) - share for pool, share in pooled(self.items)]
        return np.minimum(0.0, np.min(paid, axis=0))


def measured(source: str, options: argparse.Namespace) -> tuple[Evidence, ...]:
    """Measure a source."""
    return gather(
        meshmark.read(source),
        recipes=[Recipe(options.scheme)],
        frames=options.frames,
        restored=not options.plain,
        jobs=default_jobs(),
    ).items


def stored(folder: Path, scheme: str) -> Iterator[tuple[str, tuple[Evidence, ...]]]:
    """Read what a store holds by a scheme."""
    for path in EvidenceStore(folder).paths():
        for row in rows(path):
            found = row.load()
            yield found.path, tuple(item for item in found.items if item.scheme == scheme)


def try_keys(items: tuple[Evidence, ...], n_keys: int, up_to: float) -> FloatArray:
    """Return log10 p of many keys on all parts of a source."""
    blocks = range(-(-n_keys // AT_ONCE))
    log10_p = list(ordered_map(TryKeys(items, up_to), blocks, jobs=default_jobs()))
    return np.concatenate(log10_p)[:n_keys]


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
    parser.add_argument("sources", nargs="*")
    parser.add_argument("--store", type=Path, help="what `verify --store` kept")
    parser.add_argument("--keys", type=int, default=100_000)
    parser.add_argument("--scheme", default="apex")
    parser.add_argument("--frames", default=":", help="range A:B[:S] of time codes")
    parser.add_argument("--plain", action="store_true", help="leave out undone smoothing")
    parser.add_argument("--up-to", type=float, default=1.0, help="highest p that is told")
    parser.add_argument("-o", "--output", type=Path, default=Path())
    options = parser.parse_args()
    results: dict[str, FloatArray] = {}
    levels = [level for level in LEVELS if 10.0**level <= options.up_to]
    heads = " | ".join(f"p <= 1e{level:g}" for level in levels)
    print(f"| source | parts | {heads} | lowest log10 p |")
    print("| --- |" + " --- |" * (len(levels) + 2))
    found = ((source, measured(source, options)) for source in options.sources)
    kept = () if options.store is None else stored(options.store, options.scheme)
    for source, items in chain(found, kept):
        log10_p = try_keys(items, options.keys, options.up_to)
        counts = " | ".join(str(int(np.count_nonzero(log10_p <= level))) for level in levels)
        print(
            f"| {Path(source).stem} | {len(items)} | {counts} | {log10_p.min():.2f} |", flush=True
        )
        results[Path(source).stem] = log10_p
    draw(results, options.output / "false-positives.png")


if __name__ == "__main__":
    main()
