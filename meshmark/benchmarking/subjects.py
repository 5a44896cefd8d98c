"""The assets of a benchmark: their short names, files and frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from meshmark.mesh.animation import InMemoryFrames, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.frame_range import frames_in
from meshmark.sources.digests import file_hashes, source_digests
from meshmark.sources.reading import read

# Two frames this near each other count as one: RMS over the points, share of the diagonal.
REPEATED = 1e-3


@dataclass(frozen=True)
class Subject:
    """One asset of a benchmark.

    Parameters
    ----------
    asset : str
        Short name: the file's or folder's without its suffix.
    source : str
        As it was typed.
    frames : str or None
        Range of time codes that is marked, attacked and verified.
    files : tuple of (str, str)
        Name and SHA-256 of every file it consists of; names relative to the source's folder.
    """

    asset: str
    source: str
    frames: str | None
    files: tuple[tuple[str, str], ...]

    def load(self) -> Asset:
        """Read the asset's chosen frames."""
        return select_frames(read(self.source), self.frames)


def subjects_of(
    sources: Sequence[str], frames: str | None, *, isolated: bool = False
) -> tuple[Subject, ...]:
    """Look at the sources before any work is done.

    Parameters
    ----------
    isolated : bool
        Look at them in a process of its own, as `meshmark.read` can.

    Raises
    ------
    InputError
        If one cannot be read.
    UsageError
        If one has no frame in the range.
    """
    names = short_names(sources)
    return tuple(
        _subject(name, source, frames, isolated)
        for name, source in zip(names, sources, strict=True)
    )


def short_names(sources: Sequence[str]) -> list[str]:
    """Name sources by their stems where those differ, by their whole text where they do not."""
    stems = [Path(source).stem or source for source in sources]
    return [
        stem if stems.count(stem) == 1 else source
        for stem, source in zip(stems, sources, strict=True)
    ]


def _subject(name: str, source: str, frames: str | None, isolated: bool) -> Subject:
    asset = read(source, isolated=isolated)
    for mesh in asset.meshes:
        frames_in(mesh, frames)
    hashes = file_hashes(source_digests(asset), Path(source).resolve().parent)
    return Subject(name, source, frames, tuple((h["file"], h["sha256"]) for h in hashes))


def select_frames(asset: Asset, frames: str | None) -> Asset:
    """Keep the frames in a range of every mesh."""
    if frames is None:
        return asset
    meshes = tuple(mesh.select(frames_in(mesh, frames)) for mesh in asset.meshes)
    return replace(asset, meshes=meshes)


def select_first(asset: Asset) -> Asset:
    """Keep the first frame of every mesh."""
    return replace(asset, meshes=tuple(mesh.select((0,)) for mesh in asset.meshes))


def in_memory(asset: Asset, *, stored: bool = False) -> Asset:
    """Read every frame now.

    Parameters
    ----------
    stored : bool
        Round positions to float32, as a file would.
    """
    return replace(asset, meshes=tuple(_held(mesh, stored) for mesh in asset.meshes))


def _held(mesh: MeshAnimation, stored: bool) -> MeshAnimation:
    frames = tuple(mesh)
    if stored:
        frames = tuple(
            frame.moved(frame.points.astype(np.float32).astype(np.float64)) for frame in frames
        )
    return replace(mesh, source=InMemoryFrames(frames))


def count_distinct(mesh: MeshAnimation) -> int:
    """Count the frames that differ from every earlier one, `REPEATED` being no difference.

    Frames that repeat earlier ones are no further evidence of robustness.
    """
    if not mesh.constant_topology:
        return len(mesh)
    kept = np.empty((0, 0))
    for frame in mesh:
        flat = frame.points.reshape(1, -1)
        diagonal = float(np.linalg.norm(np.ptp(frame.points, axis=0)))
        # float32 keeps a long animation's frames affordable; the tolerance is far coarser.
        if kept.size == 0:
            kept = flat.astype(np.float32)
            continue
        rms = np.sqrt(3.0 * np.mean((kept - flat) ** 2, axis=1))
        if rms.min() > REPEATED * diagonal:
            kept = np.concatenate([kept, flat.astype(np.float32)])
    return len(kept)
