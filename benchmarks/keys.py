"""How long many keys take on stored evidence: very many on one source, many on many sources.

    python benchmarks/keys.py [--store FOLDER] [--keys N] [--many-keys N] [--sources N]

Measures the horse, the dancer and the cow, marked by the last of the keys, unmarked and attacked,
and keeps that in the store; what is there already is not measured again. Then tries

- a million keys on the evidence of the marked horse,
- a thousand keys on ten thousand sources: the evidence that was measured, each time with the signs
  of chips changed at random, which is as good as new evidence where keys are random.

Wall clock depends on what else the machine does: the load is printed beside it.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import resource
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import overload

import numpy as np

from measuring import data_folder, run, table
from meshmark.commands.try_keys import try_keys
from meshmark.detection.evidence import Evidence, RestoredVariant
from meshmark.detection.evidence_file import StoredEvidence
from meshmark.detection.evidence_store import EvidenceStore, rows
from meshmark.keys import Key
from meshmark.workers.ordered_map import default_jobs

# Animations, and the share of their frames that is measured.
ANIMATIONS = {"horse-gallop": 0.25, "samba": 0.1, "pcow": 0.1}
ATTACKS = {
    "noise": ("noise", "-p", "amplitude=0.005"),
    "smoothing": ("smoothing", "-p", "iterations=30"),
    "simplification": ("simplification", "-p", "ratio=0.5"),
    "similarity": ("similarity",),
}
MARKED = "marked-horse-gallop"
COLUMNS = ("keys", "sources", "found", "CPU, s", "wall, s", "load", "peak of a process, MB")


class NumberedKeys(Sequence[Key]):
    """Keys that are made when they are asked for, the same in every run."""

    def __init__(self, n: int) -> None:
        self._numbers = range(n)

    def __len__(self) -> int:
        return len(self._numbers)

    @overload
    def __getitem__(self, index: int) -> Key: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Key]: ...

    def __getitem__(self, index: int | slice) -> Key | Sequence[Key]:
        if isinstance(index, slice):
            return [_key(number) for number in self._numbers[index]]
        return _key(self._numbers[index])


def _key(number: int) -> Key:
    return Key(hashlib.sha256(f"many keys {number}".encode()).digest())


def measure(folder: Path, work: Path, last: Key) -> None:
    """Measure reference animations, marked, unmarked and attacked, into a store."""
    last.save(work / "k")
    sources = []
    for name, share in ANIMATIONS.items():
        window = ("-p", f"share={share}", "-p", "start=0")
        run(
            "attack",
            "window",
            data_folder() / f"{name}.usdc",
            "-o",
            f"{name}.usdc",
            *window,
            cwd=work,
        )
        sources.append(f"{name}.usdc")
        for label, attack in ATTACKS.items():
            copy = f"{name}-{label}.usdc"
            run("attack", attack[0], f"{name}.usdc", "-o", copy, *attack[1:], cwd=work)
            sources.append(copy)
    run(
        "embed",
        "horse-gallop.usdc",
        "-o",
        f"{MARKED}.usdc",
        "--key",
        "k",
        "--scheme",
        "apex",
        cwd=work,
    )
    for source in [f"{MARKED}.usdc", *sources]:
        run("verify", source, "--scheme", "apex", "--key", "k", "--store", folder, cwd=work)


def changed(stored: StoredEvidence, number: int) -> StoredEvidence:
    """Change the signs of chips at random: what random keys make of it is distributed alike."""
    rng = np.random.default_rng(number)
    items = tuple(_changed(item, rng) for item in stored.items)
    digest = hashlib.sha256(f"{stored.path} {number}".encode()).hexdigest()
    return replace(
        stored, items=items, path=f"{stored.path} {number}", files=(("changed", digest),)
    )


def _changed(item: Evidence, rng: np.random.Generator) -> Evidence:
    variants = []
    for variant in item.variants:
        signs = rng.choice((-1.0, 1.0), variant.shape[2:])
        variants.append(
            RestoredVariant.of(
                (variant.pooled * signs)[None],
                variant.log_prior,
                variant.restored,
                variant.log_belief,
                None if variant.posterior is None else (variant.posterior,),
            )
        )
    return replace(item, variants=tuple(variants))


def kept(folder: Path) -> Iterator[StoredEvidence]:
    for path in EvidenceStore(folder).paths():
        yield from (row.load() for row in rows(path))


def timed(store: EvidenceStore, n_keys: int) -> list[object]:
    """Try keys, and tell what that took; the peak is that of the largest process so far."""
    before, wall = _cpu(), time.perf_counter()
    trials, refusals = try_keys(store, NumberedKeys(n_keys), jobs=default_jobs())
    wall = time.perf_counter() - wall
    assert not refusals
    found = sum(bool(trial.matches) for trial in trials)
    peak = max(
        resource.getrusage(who).ru_maxrss
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    load = os.getloadavg()[0]
    return [
        f"{n_keys:,}",
        f"{len(trials):,}",
        found,
        f"{_cpu() - before:.1f}",
        f"{wall:.1f}",
        f"{load:.1f}",
        f"{peak / 1024:.0f}",
    ]


def _cpu() -> float:
    both = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in both)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--store", type=Path, help="where what is measured stays")
    parser.add_argument("--many-keys", type=int, default=1_000_000, help="on one source")
    parser.add_argument("--keys", type=int, default=1000, help="on many sources")
    parser.add_argument("--sources", type=int, default=10_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="meshmark-keys-") as work:
        place = Path(work) if options.store is None else options.store.absolute()
        if not (place / "measured").is_dir():
            measure(place / "measured", Path(work), _key(options.many_keys - 1))
        measured = list(kept(place / "measured"))
        one = EvidenceStore(place / "one")
        [marked] = [each for each in measured if MARKED in each.path]
        one.add(marked)
        print(table(COLUMNS, [timed(one, options.many_keys)]), flush=True)
        many = EvidenceStore(place / "many")
        there = len(many.paths()) if many.folder.is_dir() else 0
        unmarked = [each for each in measured if MARKED not in each.path]
        for number in range(there, options.sources):
            many.add(changed(unmarked[number % len(unmarked)], number))
        print(table(COLUMNS, [timed(many, options.keys)]))


if __name__ == "__main__":
    main()
