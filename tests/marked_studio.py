"""A studio that has marked many assets for many recipients, made cheaply."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from meshmark.commands.attack import write_attacked
from meshmark.ledger.chain import Link
from meshmark.ledger.database import database
from meshmark.ledger.marks import mark_of
from meshmark.ledger.schema import entries, head
from meshmark.ledger.store import Ledger, _row
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import as_asset
from meshmark.sources.digests import sha256
from meshmark.testing.meshes import icosphere


def rock(seed: int, level: int = 4) -> MeshAnimation:
    """Return a ball of 2562 points with waves of its own."""
    V, F = icosphere(level)
    rng = np.random.default_rng(seed)
    waves = [
        0.12 * rng.normal() * np.sin(3 * V @ rng.normal(size=3) + rng.uniform(0, 6))
        for _ in range(8)
    ]
    return MeshAnimation.from_arrays(V * (1 + sum(waves))[:, None], F, prim="/Rock")


def write_rocks(seeds: Iterable[int], folder: Path) -> list[Path]:
    paths = [folder / f"rock{seed:03}.usdc" for seed in seeds]
    for seed, path in zip(seeds, paths, strict=True):
        write_attacked(as_asset(rock(seed)), path)
    return paths


def record_for_all(
    where: str, sources: Sequence[Path], recipients: Sequence[str], manifest: dict[str, Any]
) -> None:
    """Append a copy of every source for every recipient, as if each had been marked.

    All in one transaction: each for itself takes minutes on a slow disk.
    """
    sequence, previous = Ledger(where).head()
    links: list[Link] = []
    text = json.dumps(manifest)
    for source in sources:
        files = [{"file": source.name, "sha256": sha256(source)}]
        for number, recipient in enumerate(recipients):
            told = json.loads(text)
            told["source"] |= {"path": source.name, "files": files}
            told |= {"recipient": recipient, "output": f"{source.stem}-{number}.usdc"}
            content = mark_of(told, source.parent / told["output"])
            when = {"recorded_at": "2026-01-01T00:00:00+00:00", "recorded_by": "td"}
            place = sequence + len(links) + 1
            last = links[-1].hash if links else previous
            links.append(Link.of({**content, "sequence": place, **when}, last))
    with database(where).writing() as connection:
        for link in links:
            connection.execute(entries.insert().values(_row(link)))
            connection.execute(head.update().values(sequence=link.sequence, hash=link.hash))
