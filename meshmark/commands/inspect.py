"""Foresees, without a key, whether the meshes of an asset can hold a mark."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

import numpy as np

from meshmark.detection.extraction import extract
from meshmark.errors import CapacityError, InputError, NoExtentError
from meshmark.extension.breakdown import breakdown_means_no_capacity
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.checks import bad_frames
from meshmark.mesh.precision import require_precision
from meshmark.mesh.welding import Welding


def inspect_asset(asset: Asset, recipe: Recipe) -> dict[str, Any]:
    """Describe an asset as `inspect --json` prints it.

    Parameters
    ----------
    recipe : Recipe
        The scheme that is to hold the mark; it is tried on the first frame.

    Returns
    -------
    dict
        JSON values; its schema is `schemas/json/inspect.schema.json`.
    """
    return {
        "source": asset.source,
        "reader": asset.reader,
        "up_axis": asset.up_axis,
        "meters_per_unit": asset.meters_per_unit,
        "fps": asset.fps,
        "scheme": recipe.scheme,
        "notes": list(asset.notes),
        "prims": [_prim(animation, recipe) for animation in asset.meshes],
    }


def _prim(animation: MeshAnimation, recipe: Recipe) -> dict[str, Any]:
    bad = dict(bad_frames(animation))
    index = next((i for i in range(len(animation)) if i not in bad), next(iter(bad), 0))
    first = animation[index]
    entry: dict[str, Any] = {
        "prim": animation.prim,
        "frames": len(animation),
        "points": first.topology.n_points,
        "faces": len(first.topology.counts),
        "constant_topology": animation.constant_topology,
        "notes": [*animation.notes, *_passed_over(bad.values())],
        "can_hold": False,
        "reason": None,
        "parts": 0,
        "carriers": 0,
        "chips": 0,
        "reachable_log10_p": 0.0,
    }
    try:
        with breakdown_means_no_capacity():
            entry["parts"] = count_parts(first, recipe)
        _require_marking(animation, bad.values())
        entry["notes"] += require_precision(animation, first)
        scheme = recipe.build()
        sound = animation.select([i for i in range(len(animation)) if i not in bad])
        with breakdown_means_no_capacity():
            scheme.require_capacity(sound.map(Welding.of(first).frame), jobs=1)
        evidence = extract(animation, scheme, recipe.scheme, frames=(index,))
    except (CapacityError, InputError) as error:
        return {**entry, "reason": error.message}
    return {
        **entry,
        "can_hold": True,
        "carriers": evidence.carriers,
        "chips": evidence.chips,
        "reachable_log10_p": evidence.reachable_log10_p,
    }


def _require_marking(animation: MeshAnimation, bad: Collection[InputError]) -> None:
    """Refuse what `embed` does: frames and faces that cannot be read, and faces that change."""
    if animation.flaw:
        raise InputError(animation.flaw)
    unreadable = [error for error in bad if not isinstance(error, NoExtentError)]
    if unreadable:
        raise InputError(f"{len(unreadable)} bad frames: {unreadable[0].without_source()}")
    if len(bad) == len(animation):
        raise next(iter(bad))
    if not animation.constant_topology:
        raise InputError("the connectivity changes over time")


def _passed_over(bad: Iterable[InputError]) -> list[str]:
    empty = [error for error in bad if isinstance(error, NoExtentError)]
    return [f"{len(empty)} frames would be passed over: {empty[0].message}"] if empty else []


def count_parts(frame: Frame, recipe: Recipe) -> int:
    """Count the parts the recipe's segmenter finds in a frame."""
    analysed = Welding.of(frame).frame(frame)
    labels = recipe.build_segmenter().segment(analysed.points, analysed.faces)
    return len(np.unique(labels))
