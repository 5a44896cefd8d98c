"""A layer over a source: what it must say to look like the source when opened by itself."""

from __future__ import annotations

from pathlib import Path

from pxr import Sdf, Usd

from meshmark.usd.layers import sublayer_path

# USD asks these of the root layer alone, never of its sublayers.
STAGE_METADATA = (
    "colorConfiguration",
    "colorManagementSystem",
    "defaultPrim",
    "endTimeCode",
    "expressionVariables",
    "framesPerSecond",
    "kilogramsPerUnit",
    "metersPerUnit",
    "renderSettingsPrimPath",
    "startTimeCode",
    "timeCodesPerSecond",
    "upAxis",
)


def lay_over(layer: Sdf.Layer, stage: Usd.Stage, source: str, output: Path) -> None:
    """Make a layer that will lie at `output` show the stage of `source`, unchanged so far."""
    copy_stage_metadata(stage.GetRootLayer(), layer)
    layer.subLayerPaths.append(sublayer_path(Path(source), output))


def copy_stage_metadata(source: Sdf.Layer, target: Sdf.Layer) -> None:
    """Copy what the source authors of the metadata that counts in a root layer only."""
    for name in STAGE_METADATA:
        if source.pseudoRoot.HasInfo(name):
            target.pseudoRoot.SetInfo(name, source.pseudoRoot.GetInfo(name))
