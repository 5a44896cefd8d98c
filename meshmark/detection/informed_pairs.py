"""What of a copy is read beside what of its original: all, or run by run where that changes.

Where the connectivity of an original changes over time, each run of frames with one connectivity
was marked by itself, and is an original of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from meshmark.alignment.align import FRAMES, align
from meshmark.alignment.placement import AssetAlignment
from meshmark.errors import InputError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.frame_range import has_frame_in
from meshmark.mesh.runs import cut, longest, runs, span

# Runs of one mesh that are read, the longest.
MOST_RUNS = 12


@dataclass(frozen=True, eq=False)
class Pair:
    """What is to be read beside what.

    Parameters
    ----------
    copy, original : Asset
    run : range or None
        Which frames of its mesh the original is; None if it is all of its meshes.
    share : int
        Among how many pairs the frames that are read are divided.
    """

    copy: Asset
    original: Asset
    run: range | None = None
    share: int = 1

    @property
    def part(self) -> str:
        """Which frames of the original; empty for all."""
        return "" if self.run is None else _name(self.original.meshes[0])

    def reference(self, master: MeshAnimation) -> MeshAnimation:
        """Return the frames of a master that are this original's."""
        return master if self.run is None else cut(master, self.run)


def pairs(copy: Asset, original: Asset, frames: str | None = None) -> list[Pair]:
    """List what is read beside what.

    A run is looked for in frames of the copy that have as many points, or if there are none, in
    those of the same time.

    Parameters
    ----------
    frames : str, optional
        Range A:B[:S] of the copy's time codes: runs of which it shows nothing there are left out.
    """
    changing = [mesh for mesh in original.meshes if not mesh.constant_topology]
    if not changing:
        return [Pair(copy, original)]
    constant = tuple(mesh for mesh in original.meshes if mesh.constant_topology)
    found = [Pair(copy, replace(original, meshes=constant))] if constant else []
    for mesh in changing:
        chosen = longest(runs(mesh), MOST_RUNS)
        near = sorted(copy.meshes, key=lambda each: each.prim != mesh.prim)
        pieces = [piece for each in near for piece in _pieces(each)]
        for run in chosen:
            part = cut(mesh, run)
            shown = tuple(_like(part, pieces) or _during(part, near))
            if any(has_frame_in(each, frames) for each in shown):
                beside = replace(original, meshes=(part,))
                found.append(Pair(replace(copy, meshes=shown), beside, run, len(chosen)))
    return found


def aligned(
    pair: Pair, copy: Asset, original: Asset, *, frames: str | None = None, jobs: int = 1
) -> AssetAlignment:
    """Find where the copy of a pair lies on its original, once for everybody who asks.

    Who asks again reads it beside a master, or shows it.

    Parameters
    ----------
    pair : Pair
        One of those of `copy` and `original`.
    frames, jobs
        As of `align`.
    """
    # Nobody else is kept in memory by this: what is found has their meshes only.
    known = _found.setdefault(copy, WeakKeyDictionary()).setdefault(original, {})
    which = (tuple(mesh.prim for mesh in pair.original.meshes), pair.run, frames)
    if which not in known:
        n_frames = max(1, FRAMES // pair.share)
        known[which] = align(pair.copy, pair.original, frames=frames, n_frames=n_frames, jobs=jobs)
    return known[which]


_found: WeakKeyDictionary[Asset, WeakKeyDictionary[Asset, dict[Any, AssetAlignment]]] = (
    WeakKeyDictionary()
)


def run_named(mesh: MeshAnimation, part: str) -> MeshAnimation:
    """Return the run of a mesh of the original that `Pair.part` calls so; all if it names none."""
    every = (cut(mesh, run) for run in (runs(mesh) if part else ()))
    return next((run for run in every if _name(run) == part), mesh)


def _name(run: MeshAnimation) -> str:
    return f"frames {span(run)}"


def _pieces(mesh: MeshAnimation) -> list[MeshAnimation]:
    return [mesh] if mesh.constant_topology else [cut(mesh, run) for run in runs(mesh)]


def _like(part: MeshAnimation, pieces: Sequence[MeshAnimation]) -> list[MeshAnimation]:
    """List pieces of a copy that have as many points as a run, the nearest in time first."""
    n_points = part[0].topology.n_points
    alike = [piece for piece in pieces if _n_points(piece) == n_points]
    return sorted(alike, key=lambda piece: float(np.abs(piece.times[0] - part.times[0])))


def _n_points(piece: MeshAnimation) -> int | None:
    try:
        return piece[0].topology.n_points
    except InputError:
        return None


def _during(part: MeshAnimation, meshes: Sequence[MeshAnimation]) -> Iterator[MeshAnimation]:
    """Cut what meshes show while a run lasts."""
    for mesh in meshes:
        during = (mesh.times >= part.times[0]) & (mesh.times <= part.times[-1])
        if during.any():
            yield mesh.select(np.flatnonzero(during).tolist())
