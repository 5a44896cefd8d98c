"""How often a random key finds a mark: on evidence kept by `meshmark verify --evidence`.

    python benchmarks/false_positives.py marked.evidence unmarked.evidence --keys 100000 -o FOLDER

Writes `false-positives.png`, the share of keys whose p is at most a against a, and prints the
table that goes with it. A p-value is honest if no curve lies above the diagonal.
"""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshmark.evidence import Evidence
from meshmark.evidence_file import load_evidence
from meshmark.judging import log10_p_of
from meshmark.keys import Key
from meshmark.parallel import default_jobs, ordered_map

FloatArray = NDArray[np.float64]

AT_ONCE = 500
LEVELS = (-1.0, -2.0, -3.0, -4.0, -6.0)


@dataclass(frozen=True)
class TryKeys:
    """Tries a block of keys, numbered and the same in every run, on evidence."""

    evidence: Evidence

    def __call__(self, block: int) -> FloatArray:
        numbers = range(block * AT_ONCE, (block + 1) * AT_ONCE)
        keys = [Key(hashlib.sha256(f"false positives {n}".encode()).digest()) for n in numbers]
        words = np.array([self.evidence.words(key, None) for key in keys])
        return np.asarray(log10_p_of(self.evidence, words))


def try_keys(path: Path, n_keys: int, plain: bool) -> FloatArray:
    """Return log10 p of many keys on the first mesh of an evidence file."""
    evidence = load_evidence(path).items[0]
    if plain:
        evidence = replace(evidence, strands=evidence.strands[:1])
    blocks = range(-(-n_keys // AT_ONCE))
    found = list(ordered_map(TryKeys(evidence), blocks, jobs=default_jobs()))
    return np.concatenate(found)[:n_keys]


def draw(results: dict[str, FloatArray], path: Path) -> None:
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6, 4.5), dpi=110)
    for name, log10_p in results.items():
        ordered = np.sort(log10_p)
        share = np.arange(1, len(ordered) + 1) / len(ordered)
        axes.step(10**ordered, share, where="post", label=name)
    axes.plot([1e-6, 1], [1e-6, 1], color="0.6", linestyle=":", label="honest limit")
    axes.set(xscale="log", yscale="log", xlim=(1e-6, 1), ylim=(5e-6, 1.5))
    axes.set(xlabel="a", ylabel="share of random keys with p at most a")
    axes.legend(loc="upper left", fontsize=8, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("evidence", nargs="+", type=Path)
    parser.add_argument("--keys", type=int, default=100_000)
    parser.add_argument("--plain", action="store_true", help="leave out undone smoothing")
    parser.add_argument("-o", "--output", type=Path, default=Path())
    options = parser.parse_args()
    results = {path.stem: try_keys(path, options.keys, options.plain) for path in options.evidence}
    heads = " | ".join(f"p <= 1e{level:g}" for level in LEVELS)
    print(f"| evidence | {heads} | lowest log10 p |")
    print("| --- |" + " --- |" * (len(LEVELS) + 1))
    for name, log10_p in results.items():
        counts = " | ".join(str(int(np.count_nonzero(log10_p <= level))) for level in LEVELS)
        print(f"| {name} | {counts} | {log10_p.min():.2f} |")
    draw(results, options.output / "false-positives.png")


if __name__ == "__main__":
    main()
