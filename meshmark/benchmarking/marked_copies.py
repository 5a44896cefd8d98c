"""Marked copies of the assets: each made once, kept as a file, found again by any process."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from meshmark.benchmarking.subjects import Subject, select_frames
from meshmark.delivery.unmarked import split_fit, split_in_place
from meshmark.embedding.asset import embed
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.asset import Asset
from meshmark.sources.reading import read
from meshmark.sources.writing import writer, written_names
from meshmark.workers.progress import MeshProgress


def recipients(others: int) -> list[str | None]:
    """Name whom copies are marked for: nobody, and as many others for attacks that need more."""
    return [None, *(f"copy {number}" for number in range(1, others + 1))]


@dataclass(frozen=True)
class MarkedCopy:
    """A marked file, and which of its meshes are marked.

    Parameters
    ----------
    path : Path
        The file; an override layer over the source, or a stage of its own.
    prims : tuple of (str, str)
        Path of each marked mesh in the source, and in the file.
    frames : str or None
        Range of time codes that is marked.
    """

    path: Path
    prims: tuple[tuple[str, str], ...]
    frames: str | None

    def load(self) -> Asset:
        """Read the marked frames of the marked meshes, under the source's names."""
        asset = read(self.path, [written for _, written in self.prims])
        named = tuple(replace(asset.mesh(written), prim=prim) for prim, written in self.prims)
        return select_frames(replace(asset, meshes=named), self.frames)


def make_copy(
    subject: Subject,
    recipe: Recipe,
    key: Key,
    recipient: str | None,
    path: Path,
    *,
    jobs: int,
    progress: MeshProgress | None,
) -> dict[str, Any]:
    """Mark an asset, write the copy, and describe it in JSON values.

    Raises
    ------
    MeshmarkError
        If it cannot be read or marked.
    """
    start = time.perf_counter()
    original = read(subject.source)
    write = writer(original, path)
    marked = embed(
        split_in_place(split_fit(original)),
        key,
        recipe=recipe,
        recipient=recipient,
        frames=subject.frames,
        jobs=jobs,
        progress=progress,
    )
    write(marked.asset)
    written = written_names(original, path)
    return {
        "file": path.name,
        "prims": [[mesh.animation.prim, written[mesh.animation.prim]] for mesh in marked.meshes],
        "skipped": [[each.prim, each.reason] for each in marked.skipped],
        "carriers": sum(mesh.carriers for mesh in marked.meshes),
        "timings": {"embed_s": round(time.perf_counter() - start, 3)},
    }


def copy_of(path: Path, frames: str | None, described: dict[str, Any]) -> MarkedCopy:
    """Return the copy that `make_copy` described."""
    prims = tuple((str(prim), str(written)) for prim, written in described["prims"])
    return MarkedCopy(path, prims, frames)
