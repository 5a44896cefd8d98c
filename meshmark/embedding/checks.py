"""What is checked of a file that was just written: frames spread over its animation, or all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from meshmark.detection.gathering import gather
from meshmark.detection.joint_verdict import TRIPLE, jointly, together
from meshmark.detection.looks import EVERYTHING, Look
from meshmark.detection.verdict import Verdict
from meshmark.detection.verify import judge_all, judge_beside
from meshmark.embedding.asset import MarkedAsset, MarkedMesh
from meshmark.extension.recipe import Recipe, mrms_limit
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.metrics import Distortion, distortion
from meshmark.metrics.surface_distance import default_samples
from meshmark.workers.memory import give_back_memory
from meshmark.workers.progress import MeshProgress

# Frames of each mesh that are checked, and points of each surface that distances are taken at.
FRAMES, SAMPLES = 12, 20_000
# Points of each mesh that are read beside the original: a few of these frames, of a large mesh.
POINTS = 30_000
# The limit to the distortion is in doubt if it is no more standard errors away than this.
DOUBT = 3.0
# The false positive rate that what was written is verified at.
TARGET_FPR = 1e-6
# What of the frames that are checked is read by itself first, and the log10 p that each mesh has to
# reach for that to do: so far below the rate that the chance of two looks adds nothing to it.
FIRST_LOOK = replace(EVERYTHING, frames=4)
PROVEN = 2.0 * float(np.log10(TARGET_FPR))


def checked_frames(mesh: MarkedMesh, check_all: bool) -> tuple[int, ...]:
    """Choose the marked frames of a mesh that are checked; all where its connectivity changes."""
    frames = mesh.frames
    if check_all or len(frames) <= FRAMES or not mesh.original.constant_topology:
        return frames
    places = np.linspace(0, len(frames) - 1, FRAMES).round().astype(np.int64)
    return tuple(frames[place] for place in places.tolist())


def measure_distortion(
    mesh: MarkedMesh,
    shown: MeshAnimation,
    coordinates: dict[str, Any],
    layers: Sequence[Recipe],
    *,
    check_all: bool,
    jobs: int,
) -> Distortion:
    """Measure how far a mesh was moved, in the frames that are checked, at some points.

    In all frames, and at more points, if those leave it in doubt whether the limit is kept.

    Parameters
    ----------
    mesh : MarkedMesh
    shown : MeshAnimation
        As it was written.
    coordinates : dict
        Texture coordinates, as `distortion` takes them.
    layers : sequence of Recipe
        What it was marked by.
    check_all : bool
        Whether to compare all frames in any case.
    jobs : int
        Processes that work, this one among them.
    """
    marked, limit = mesh.frames, mrms_limit(layers)
    pair = mesh.original.select(marked), shown.select(marked)
    some = [marked.index(frame) for frame in checked_frames(mesh, check_all)]
    usual = default_samples(len(pair[0][0].faces))
    samples = min(SAMPLES, usual)
    if not check_all and (len(some) < len(marked) or samples < usual):
        found = distortion(*pair, some, samples=samples, **coordinates, jobs=jobs)
        if limit is None or found.mrms_rel + DOUBT * found.mrms_rel_error <= limit:
            return found
    return distortion(*pair, **coordinates, jobs=jobs)


def told_of_limit(found: Distortion, layers: Sequence[Recipe]) -> list[str]:
    """Say so if a mesh was moved farther than all layers together may."""
    limit = mrms_limit(layers)
    if limit is None or found.mrms_rel <= limit:
        return []
    return [f"MRMS {found.mrms_rel:.2e} of the diagonal is beyond the limit of {limit:.2e}"]


def verify_written(
    written: Asset,
    marked: MarkedAsset,
    key: Key,
    layers: Sequence[Recipe],
    *,
    recipient: str | None,
    check_all: bool,
    jobs: int,
    progress: MeshProgress | None,
) -> Verdict:
    """Verify what was written just now: nobody smoothed it, or joined anything to it.

    Parameters
    ----------
    written : Asset
        The marked meshes as they were written, in the same order.
    marked : MarkedAsset
        As they were marked; its original as it was read.
    key, layers, recipient
        What they were marked by.
    check_all : bool
        Whether to look at all frames.
    jobs : int
        Processes that work, this one among them.
    progress : callable, optional
        Called with (prim, frames done, frames in all).
    """
    blind = [layer for layer in layers if not layer.informed]
    informed = [layer for layer in layers if layer.informed]
    names = [] if recipient is None else [recipient]
    checked = replace(
        written,
        meshes=tuple(
            shown.select(checked_frames(mesh, check_all))
            for mesh, shown in zip(marked.meshes, written.meshes, strict=True)
        ),
    )
    alone = beside = None
    # What planning took, and then what reading alone did, is not to stay beside what comes next.
    give_back_memory()
    if blind:
        judged_alone = partial(
            _judge_alone, checked, key, blind, names, jobs=jobs, progress=progress
        )
        few = not check_all and all(mesh.original.constant_topology for mesh in marked.meshes)
        alone = judged_alone(FIRST_LOOK if few else EVERYTHING)
        if few and not _is_proven(alone, marked):
            alone = judged_alone(EVERYTHING)
        give_back_memory()
    if informed:
        whole = replace(marked.original, meshes=tuple(mesh.original for mesh in marked.meshes))
        judged_beside = partial(
            judge_beside,
            checked,
            key,
            informed,
            names,
            original=whole,
            master=marked.master if blind else None,
            frames=None,
            fpr=TARGET_FPR,
            share=1 / 2,
            jobs=jobs,
            progress=progress,
        )
        beside = judged_beside(points_in_place=np.inf if check_all else POINTS)
        if beside.log10_p + TRIPLE > np.log10(TARGET_FPR):
            # As `verify` would, that does not know where the copy lies.
            beside = together(beside, judged_beside())
    if alone is None or beside is None:
        one = alone or beside
        assert one is not None
        return one
    return jointly(alone, beside, TARGET_FPR)


def _judge_alone(
    written: Asset,
    key: Key,
    layers: Sequence[Recipe],
    names: Sequence[str],
    look: Look,
    *,
    jobs: int,
    progress: MeshProgress | None,
) -> Verdict:
    """Read meshes without their original, and try the key."""
    evidence = gather(
        written,
        recipes=layers,
        look=look,
        restored=False,
        parts=False,
        jobs=jobs,
        progress=progress,
    )
    return judge_all(evidence, key, recipients=names, fpr=TARGET_FPR)


def _is_proven(alone: Verdict, marked: MarkedAsset) -> bool:
    """Tell whether every mesh that holds a blind layer is known to, beyond doubt."""
    log10_p = {prim.prim: prim.log10_p for prim in alone.prims}
    blind = [
        mesh.animation.prim
        for mesh in marked.meshes
        if any(not layer.informed for layer in mesh.layers)
    ]
    return all(log10_p.get(prim, 0.0) <= PROVEN for prim in blind)
