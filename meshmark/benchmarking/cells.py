"""One cell: attack a copy, store it as a file would, and verify it blindly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from meshmark.benchmarking.marked_copies import MarkedCopy
from meshmark.benchmarking.subjects import Subject, in_memory, select_first
from meshmark.benchmarking.suite_rows import NO_ATTACK, Cell
from meshmark.benchmarking.timing import StageClock, TimedRecipe
from meshmark.commands.attack import attack_asset
from meshmark.detection.gathering import gather
from meshmark.detection.verdict import PrimVerdict, Verdict
from meshmark.detection.verify import judge_all
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import make_attack
from meshmark.files.atomic import number
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.metrics import Distortion, distortion
from meshmark.metrics.surface_distance import surface_distance
from meshmark.sources.facts import texture_coordinates

FPR = 1e-6
# What an unmarked frame's best part shows by luck several times in a hundred: 3 bits of 16.
LUCKY_BER = 0.1875


def run_cell(
    cell: Cell,
    seed: int,
    recipe: Recipe,
    key: Key,
    copies: Sequence[Subject | MarkedCopy],
) -> dict[str, Any]:
    """Attack a copy and verify what is left, in JSON values.

    Parameters
    ----------
    seed : int
        Of the attack; `meshmark attack --seed` with it repeats this very attack.
    copies : sequence of Subject or MarkedCopy
        The marked copy, or the unmarked asset for the control; then the other copies, for attacks
        that need them.

    Raises
    ------
    MeshmarkError
        If the attack or the verification cannot be done.
    """
    clock = StageClock()
    with clock.stage("read"):
        first, *others = (loaded(copy, cell) for copy in copies)
        asset = in_memory(first)
    with clock.stage("attack"):
        attacked = in_memory(attack_copy(asset, cell, seed, others), stored=True)
    timed = TimedRecipe.of(recipe, clock)
    with clock.stage("measure"):
        evidence = gather(attacked, recipes=[timed])
    with clock.stage("judge"):
        verdict = judge_all(evidence, key, fpr=FPR)
    cost = attack_mrms(asset, attacked)
    return {**describe(verdict), "attack_mrms_rel": cost, "timings": _timings(clock)}


def loaded(copy: Subject | MarkedCopy, cell: Cell) -> Asset:
    """Read the frames of a copy that a cell attacks."""
    asset = copy.load()
    return select_first(asset) if cell.frames == "first" else asset


def attack_copy(asset: Asset, cell: Cell, seed: int, others: Sequence[Asset]) -> Asset:
    """Do what a cell asks for to every mesh; `others` are what it may be blended with."""
    if cell.attack == NO_ATTACK:
        return asset
    make = partial(make_attack, cell.attack, **cell.parameters)
    if not others:
        return attack_asset(asset, make(), seed)
    meshes = [
        attack_asset(replace(asset, meshes=(mesh,)), make(other=twins), seed).meshes[0]
        for mesh, *twins in zip(asset.meshes, *(other.meshes for other in others), strict=True)
    ]
    return replace(asset, meshes=tuple(meshes))


def attack_mrms(before: Asset, after: Asset) -> float | None:
    """Measure what an attack did to the surfaces, both ways, where they are in space.

    Returns
    -------
    float or None
        Mean of MRMS over the diagonal, over meshes and their frames; None where frames went, or
        are at other times.
    """
    pairs = list(zip(before.meshes, after.meshes, strict=True))
    if not all(np.array_equal(one.times, two.times, equal_nan=True) for one, two in pairs):
        return None
    distances = [
        surface_distance(one.points, one.faces, two.points, two.faces)
        for mesh, twin in pairs
        for one, two in zip(mesh, twin, strict=True)
        # One that is scaled to nothing has no surface to compare with.
        if np.ptp(one.points, axis=0).any()
    ]
    return float(np.mean([d.mrms / d.diagonal for d in distances])) if distances else None


def _timings(clock: StageClock) -> dict[str, float]:
    """Split measuring into segmentation, distances, and what else there is to it."""
    spent = {name: clock.seconds.get(name, 0.0) for name in ("read", "attack")}
    inner = {name: clock.seconds.get(name, 0.0) for name in ("segment", "distances")}
    other = clock.seconds["measure"] - sum(inner.values()) + clock.seconds["judge"]
    return {f"{name}_s": round(s, 4) for name, s in {**spent, **inner, "other": other}.items()}


def describe(verdict: Verdict) -> dict[str, Any]:
    """Put a verdict into the fields of a report's row; BER is that of the mesh that fits best."""
    best = min(verdict.prims, key=lambda prim: prim.log10_p) if verdict.prims else None
    row: dict[str, Any] = {
        "ber_avg": None,
        "ber_max": None,
        "log10_p": verdict.log10_p,
        "log10_p_single_frame_median": 0.0,
        "verified": verdict.verdict == "marked",
        "verdict": verdict.verdict,
        "frames_measured": 0,
        "frames_lucky": 0.0,
        "worst": None,
        "notes": list(verdict.notes),
    }
    return row if best is None else {**row, **_describe_mesh(best)}


def _describe_mesh(prim: PrimVerdict) -> dict[str, Any]:
    errors = prim.finding.errors
    lucky = np.mean(errors.per_frame <= LUCKY_BER)
    return {
        "ber_avg": number(errors.average),
        "ber_max": number(errors.maximum),
        "log10_p_single_frame_median": float(np.median(prim.finding.log10_p_per_frame)),
        "frames_measured": len(prim.times),
        "frames_lucky": float(lucky),
        "worst": _worst(prim),
    }


def _worst(prim: PrimVerdict) -> dict[str, Any] | None:
    """Name the frame that makes BER_max, and the part that is best there all the same."""
    errors = prim.finding.errors
    if np.isnan(errors.per_frame).all():
        return None
    index = int(np.nanargmax(errors.per_frame))
    return {
        "prim": prim.prim,
        "time": number(prim.times[index]),
        "part": int(errors.best_part[index]),
        "ber": float(errors.per_frame[index]),
    }


def _distortion(original: Asset, mesh: MeshAnimation) -> Distortion:
    uv = texture_coordinates(original, mesh.prim)
    return distortion(original.mesh(mesh.prim), mesh, uv=uv)


def measure_distortion(subject: Subject, copy: MarkedCopy) -> dict[str, Any]:
    """Measure what marking did to each mesh, in JSON values."""
    clock = StageClock()
    with clock.stage("read"):
        original, marked = in_memory(subject.load()), in_memory(copy.load())
    with clock.stage("metrics"):
        rows = [
            {
                "prim": mesh.prim,
                **{
                    name: number(value) for name, value in vars(_distortion(original, mesh)).items()
                },
            }
            for mesh in marked.meshes
        ]
    timings = {f"{name}_s": round(seconds, 4) for name, seconds in clock.seconds.items()}
    return {"rows": rows, "timings": timings}
