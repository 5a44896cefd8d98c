"""Marked copies of the assets: each made once, kept as a file, found again by any process."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from meshmark.benchmarking.subjects import Subject, select_frames
from meshmark.delivery.unmarked import split_fit, split_in_place
from meshmark.detection.original_layout import OriginalLayout
from meshmark.embedding.asset import embed
from meshmark.embedding.mesh import embed_animation
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.asset import Asset
from meshmark.sources.reading import read
from meshmark.sources.writing import writer, written_names
from meshmark.usd.names import KEEP
from meshmark.workers.progress import MeshProgress


def recipients(copies: int) -> list[str]:
    """Name whom so many copies are marked for."""
    return [f"copy {number}" for number in range(1, copies + 1)]


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
    write = writer(original, path, primvars=KEEP)
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


def make_master(
    subject: Subject,
    layers: Sequence[Recipe],
    key: Key,
    path: Path,
    *,
    jobs: int,
    progress: MeshProgress | None,
) -> dict[str, Any]:
    """Lay down what all copies have in common, write it, and describe it in JSON values.

    Raises
    ------
    MeshmarkError
        If it cannot be read or marked.
    """
    start = time.perf_counter()
    original = read(subject.source)
    marked = embed(_chosen(subject, original), key, recipe=layers, jobs=jobs, progress=progress)
    return _written(original, marked.master, path, start)


def make_recipients_copy(
    subject: Subject,
    layers: Sequence[Recipe],
    key: Key,
    recipient: str,
    master: MarkedCopy,
    path: Path,
    *,
    jobs: int,
    progress: MeshProgress | None,
) -> dict[str, Any]:
    """Lay the informed layers on the master, write the copy, and describe it in JSON values.

    Raises
    ------
    MeshmarkError
        If it cannot be marked.
    """
    start = time.perf_counter()
    original = read(subject.source)
    chosen = _chosen(subject, original)
    informed = [layer for layer in layers if layer.informed]
    meshes = []
    for mesh in master.load().meshes:
        tell = None if progress is None else partial(progress, mesh.prim)
        for layer in informed:
            scheme = layer.build()
            mesh = embed_animation(
                mesh,
                scheme,
                layer.scheme,
                key,
                recipient=recipient,
                original=OriginalLayout(chosen.mesh(mesh.prim), scheme),
                jobs=jobs,
                progress=tell,
            ).animation
        meshes.append(mesh)
    return _written(original, replace(original, meshes=tuple(meshes)), path, start)


def _chosen(subject: Subject, original: Asset) -> Asset:
    return select_frames(split_in_place(split_fit(original)), subject.frames)


def _written(original: Asset, marked: Asset, path: Path, start: float) -> dict[str, Any]:
    writer(original, path, primvars=KEEP)(marked)
    written = written_names(original, path)
    return {
        "file": path.name,
        "prims": [[mesh.prim, written[mesh.prim]] for mesh in marked.meshes],
        "timings": {"embed_s": round(time.perf_counter() - start, 3)},
    }


def copy_of(path: Path, frames: str | None, described: dict[str, Any]) -> MarkedCopy:
    """Return the copy that `make_copy` described."""
    prims = tuple((str(prim), str(written)) for prim, written in described["prims"])
    return MarkedCopy(path, prims, frames)
