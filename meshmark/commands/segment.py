"""Parts of every mesh of an asset, to be looked at."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from meshmark.arrays import IntArray
from meshmark.errors import CapacityError, UsageError
from meshmark.extension.interfaces import Segmenter
from meshmark.extension.parameters import name_and_value
from meshmark.extension.recipe import convert
from meshmark.extension.registry import catalogue, make_segmenter
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.breakdown import breakdown_means_no_capacity
from meshmark.mesh.frame_range import frames_in
from meshmark.mesh.welding import Welding
from meshmark.usd.names import LAYER_SUFFIXES
from meshmark.usd.reader import UsdReader

Labels = Mapping[str, list[IntArray]]


def segmenter_from_text(name: str, settings: Sequence[str]) -> Segmenter:
    """Make a segmenter from its name and typed settings, `rays=25` or `sdf.rays=25`."""
    offer = catalogue().find("segmenter", name)
    values = {}
    for text in settings:
        refusal = f"--set takes NAME=VALUE or {name}.NAME=VALUE, not {text!r}"
        key, value = name_and_value(text, refusal)
        plugin, _, parameter = key.rpartition(".")
        if plugin not in ("", name):
            raise UsageError(refusal)
        values[parameter] = convert(offer, parameter, value)
    return make_segmenter(name, **values)


def segment_asset(asset: Asset, segmenter: Segmenter, frames: str | None) -> Labels:
    """Label the triangles of every mesh.

    Parameters
    ----------
    frames : str, optional
        Range of frames to segment, each by itself; without it, the first one's parts are
        taken to hold for all.

    Returns
    -------
    mapping of prim to list of (F,) int
        One array for each frame segmented.

    Raises
    ------
    CapacityError
        If a mesh is too degenerate to compute on.
    """
    return {
        mesh.prim: [
            _labels(mesh, index, segmenter)
            for index in (frames_in(mesh, frames) if frames is not None else (0,))
        ]
        for mesh in asset.meshes
    }


def _labels(mesh: MeshAnimation, index: int, segmenter: Segmenter) -> IntArray:
    frame = mesh[index]
    welding = Welding.of(frame)
    analysed = welding.frame(frame)
    labels = np.zeros(len(frame.faces), dtype=np.int64)
    try:
        with breakdown_means_no_capacity():
            labels[welding.faces] = segmenter.segment(analysed.points, analysed.faces)
    except CapacityError as error:
        raise CapacityError(
            error.message, source=mesh.origin, prim=mesh.prim, time=frame.time
        ) from None
    return labels


def write_segmented(asset: Asset, labels: Labels, frames: str | None, output: Path) -> None:
    """Write a layer with the parts over the asset's stage.

    A source that is no stage is written as one first, beside the layer, for it to lie over.

    Raises
    ------
    UsageError
        If the output is no USD layer.
    """
    if output.suffix.lower() not in LAYER_SUFFIXES:
        raise UsageError(f"parts are written as one of {', '.join(LAYER_SUFFIXES)}", source=output)
    from meshmark.usd.parts import write_parts
    from meshmark.usd.stages import as_stage

    names = UsdReader().written_names(asset)
    labels = {names[prim]: each for prim, each in labels.items()}
    stage = as_stage(asset, output.with_name(f"{output.stem}.points.usdc"))
    if frames is None:
        write_parts(stage, {prim: each[0] for prim, each in labels.items()}, output)
        return
    indices = frames_in(stage.meshes[0], frames)
    write_parts(stage, labels, output, indices)
