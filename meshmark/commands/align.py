"""Tells where the meshes of a copy lie on those of its original."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshmark.alignment.align import align
from meshmark.alignment.placement import FramePlacement, MeshAlignment
from meshmark.alignment.poses import posed
from meshmark.mesh.asset import Asset


def align_assets(
    copy: Asset, original: Asset, *, frames: str | None = None, jobs: int = 1
) -> dict[str, Any]:
    """Describe the alignment of a copy as `align --json` prints it.

    Parameters
    ----------
    copy, original : Asset
    frames : str, optional
        Range A:B[:S] of the copy's time codes; some frames of it are placed.
    jobs : int
        Processes that work, this one among them.

    Returns
    -------
    dict
        JSON values; the schema is `schemas/json/align.schema.json`.

    Raises
    ------
    UsageError
        If no mesh of the copy has a frame in the range.
    """
    found = align(copy, original, frames=frames, jobs=jobs)
    return {
        "copy": copy.source,
        "original": original.source,
        "meshes": [_mesh(each) for each in found.meshes],
        "unplaced": [{"prim": each.prim, "reason": each.reason} for each in found.unplaced],
    }


def _mesh(found: MeshAlignment) -> dict[str, Any]:
    return {
        "prim": found.original.prim,
        "copy_prims": list(found.prims),
        "method": found.method,
        "residual": found.residual,
        "covered": found.covered,
        "frames": [_frame(found, frame) for frame in found.frames],
    }


def _frame(found: MeshAlignment, frame: FramePlacement) -> dict[str, Any]:
    matrix = np.vstack([frame.maps["similarity"].matrix, [0.0, 0.0, 0.0, 1.0]])
    return {
        "time": _time(found.copy[0].times[frame.index]),
        "pose": frame.pose,
        "original_time": _time(posed(found.original, frame.pose).time),
        "residual": frame.residual,
        "covered": frame.covered,
        "similarity": matrix.ravel().tolist(),
    }


def _time(time: float) -> float | None:
    return None if np.isnan(time) else float(time)
