"""Foresees, without a key, whether the meshes of an asset can hold a mark."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.detection.extraction import extract
from meshmark.errors import CapacityError, InputError, MeshmarkError, NoExtentError
from meshmark.extension.informed import InformedScheme, layout_frame
from meshmark.extension.recipe import Recipe, in_order
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.breakdown import breakdown_means_no_capacity
from meshmark.mesh.checks import bad_frames
from meshmark.mesh.precision import require_precision
from meshmark.mesh.runs import cut, runs, span
from meshmark.mesh.welding import Welding
from meshmark.statistics.p_values import reachable_log10_p


def inspect_asset(asset: Asset, recipe: Recipe | Sequence[Recipe] | None = None) -> dict[str, Any]:
    """Describe an asset as `inspect --json` prints it.

    Parameters
    ----------
    recipe : Recipe or sequence of Recipe, optional
        The schemes that are to hold the mark, by default `default_layers`; they are tried on the
        first frame. A mesh can hold a mark if it can hold that of one of them.

    Returns
    -------
    dict
        JSON values; its schema is `schemas/json/inspect.schema.json`.
    """
    layers = in_order(recipe)
    return {
        "source": asset.source,
        "reader": asset.reader,
        "up_axis": asset.up_axis,
        "meters_per_unit": asset.meters_per_unit,
        "fps": asset.fps,
        "scheme": layers[0].scheme,
        "notes": list(asset.notes),
        "prims": [_prim(animation, layers) for animation in asset.meshes],
        "left_out": [
            {"prim": each.prim, "reason": each.reason, "guide": each.guide}
            for each in asset.left_out
        ],
    }


def _prim(animation: MeshAnimation, layers: Sequence[Recipe]) -> dict[str, Any]:
    if not animation.constant_topology:
        return _changing(animation, layers)
    bad = dict(bad_frames(animation))
    index = next((i for i in range(len(animation)) if i not in bad), next(iter(bad), 0))
    first = animation[index]
    entry: dict[str, Any] = {
        "prim": animation.prim,
        "frames": len(animation),
        "times": _span(animation.times),
        "points": first.topology.n_points,
        "places": len(np.unique(first.points, axis=0)),
        "faces": len(first.topology.counts),
        "constant_topology": animation.constant_topology,
        "notes": [*animation.notes, *_passed_over(bad.values())],
        "parts": 0,
    }
    try:
        with breakdown_means_no_capacity():
            entry["parts"] = count_parts(first, layers[0])
        _require_marking(animation, bad.values())
        entry["notes"] += require_precision(animation, first)
    except (CapacityError, InputError) as error:
        return {**entry, **_refused(error), "layers": []}
    sound = animation.select([i for i in range(len(animation)) if i not in bad])
    tried = [_layer(animation, sound, index, recipe) for recipe in layers]
    told = [{"scheme": recipe.scheme, **found} for recipe, found in zip(layers, tried, strict=True)]
    best = next((found for found in tried if found["can_hold"]), tried[0])
    if not best["can_hold"] and len(told) > 1:
        best = {**best, "reason": _reasons(told)}
    return {**entry, **best, "layers": told}


def _span(times: FloatArray) -> list[float] | None:
    """Return the first and the last time; None if nothing changes over time."""
    return None if np.isnan(times).any() else [float(times[0]), float(times[-1])]


def _reasons(layers: Iterable[dict[str, Any]]) -> str:
    return "; ".join(f"{layer['scheme']}: {layer['reason']}" for layer in layers)


def _changing(animation: MeshAnimation, layers: Sequence[Recipe]) -> dict[str, Any]:
    """Describe a mesh whose connectivity changes by its longest run of frames that holds a mark."""
    every = [cut(animation, run) for run in runs(animation)]
    reasons = [why_not(run, layers) for run in every]
    held = [run for run, reason in zip(every, reasons, strict=True) if reason is None]
    entry = _prim(max(held or every, key=len), layers)
    entry["runs"] = [
        {
            "first": float(run.times[0]),
            "last": float(run.times[-1]),
            "frames": len(run),
            "points": run[0].topology.n_points,
            "reason": reason,
        }
        for run, reason in zip(every, reasons, strict=True)
    ]
    entry |= {
        "frames": len(animation),
        "times": _span(animation.times),
        "constant_topology": False,
    }
    unreadable = [each for _, each in bad_frames(animation) if not isinstance(each, NoExtentError)]
    if unreadable:
        entry |= _refused(_bad(unreadable))
    return entry


def why_not(
    animation: MeshAnimation, recipe: Recipe | Sequence[Recipe] | None = None
) -> str | None:
    """Say why a mesh can hold no mark of any of some schemes; None if it can hold one.

    Where its connectivity changes, every run of frames is to hold one.
    """
    if not animation.constant_topology:
        every = [cut(animation, run) for run in runs(animation)]
        told = ((span(run), why_not(run, recipe)) for run in every)
        refused = [f"frames {when}: {why}" for when, why in told if why is not None]
        return f"{len(refused)} of {len(every)} runs, {refused[0]}" if refused else None
    bad = dict(bad_frames(animation))
    try:
        _require_marking(animation, bad.values())
        fit = [index for index in range(len(animation)) if index not in bad]
        require_precision(animation, animation[fit[0]])
    except (CapacityError, InputError) as error:
        return error.message
    sound = animation.select(fit)
    tried: list[dict[str, Any]] = []
    # Informed schemes come last, and are the quickest to ask.
    for layer in reversed(in_order(recipe)):
        found = _layer(animation, sound, fit[0], layer)
        if found["can_hold"]:
            return None
        tried.append({"scheme": layer.scheme, **found})
    return _reasons(tried)


def _layer(
    animation: MeshAnimation, sound: MeshAnimation, index: int, recipe: Recipe
) -> dict[str, Any]:
    """Foresee the mark of one scheme in frame `index`; `sound` has the frames that are fit."""
    scheme = recipe.build()
    try:
        with breakdown_means_no_capacity():
            if isinstance(scheme, InformedScheme):
                return _held(1, scheme.layout(layout_frame(sound)[1]).n_chips)
            welding = Welding.of(animation[index])
            scheme.require_capacity(sound.map(welding.frame), jobs=1)
        evidence = extract(animation, scheme, recipe.scheme, frames=(index,))
    except (CapacityError, InputError) as error:
        return _refused(error)
    return _held(evidence.carriers, evidence.chips, evidence.reachable_log10_p)


def _held(carriers: int, chips: int, reachable: float | None = None) -> dict[str, Any]:
    if reachable is None:
        reachable = reachable_log10_p(np.ones((1, chips), dtype=bool), 1)
    return {
        "can_hold": True,
        "reason": None,
        "carriers": carriers,
        "chips": chips,
        "reachable_log10_p": reachable,
    }


def _refused(error: MeshmarkError) -> dict[str, Any]:
    return {
        "can_hold": False,
        "reason": error.message,
        "carriers": 0,
        "chips": 0,
        "reachable_log10_p": 0.0,
    }


def _require_marking(animation: MeshAnimation, bad: Collection[InputError]) -> None:
    """Refuse what `embed` does: frames and faces that cannot be read."""
    if animation.flaw:
        raise InputError(animation.flaw)
    unreadable = [error for error in bad if not isinstance(error, NoExtentError)]
    if unreadable:
        raise _bad(unreadable)
    if len(bad) == len(animation):
        raise next(iter(bad))


def _bad(unreadable: Sequence[InputError]) -> InputError:
    return InputError(f"{len(unreadable)} bad frames: {unreadable[0].without_source()}")


def _passed_over(bad: Iterable[InputError]) -> list[str]:
    empty = [error for error in bad if isinstance(error, NoExtentError)]
    return [f"{len(empty)} frames would be passed over: {empty[0].message}"] if empty else []


def count_parts(frame: Frame, recipe: Recipe) -> int:
    """Count the parts the recipe's segmenter finds in a frame."""
    analysed = Welding.of(frame).frame(frame)
    labels = recipe.build_segmenter().segment(analysed.points, analysed.faces)
    return len(np.unique(labels))
