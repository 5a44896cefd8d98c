"""Where a copy lies on its original that was written from it just now: where it was read."""

from __future__ import annotations

import numpy as np

from meshmark.alignment.fit import FITS
from meshmark.alignment.placement import (
    AssetAlignment,
    FramePlacement,
    MeshAlignment,
    PolynomialMap,
)
from meshmark.alignment.search import IDENTITY
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.frame_range import spread
from meshmark.mesh.geometry import lengths, surface_box

# Frames of each mesh that are placed at least, if it has so many.
FEWEST = 4


def in_place(copy: Asset, original: Asset, n_points: float) -> AssetAlignment | None:
    """Check that each mesh of the original stands in a copy, vertex by vertex and time by time.

    Parameters
    ----------
    copy, original : Asset
    n_points : float
        How many points of each mesh are to be read: in `FEWEST` frames at least, spread evenly;
        inf for all frames.

    Returns
    -------
    AssetAlignment or None
        None if some mesh does not stand there: it has to be looked for, see `align`.
    """
    found = []
    for mesh in original.meshes:
        twins = (each for each in copy.meshes if each.prim == mesh.prim)
        placed = next(filter(None, (_in_place(twin, mesh, n_points) for twin in twins)), None)
        if placed is None:
            return None
        found.append(placed)
    return AssetAlignment(tuple(found))


def _in_place(
    copy: MeshAnimation, original: MeshAnimation, n_points: float
) -> MeshAlignment | None:
    topology = copy[0].topology
    if not (copy.constant_topology and topology.same_as(original[0].topology)):
        return None
    n_frames = max(FEWEST, n_points / topology.n_points)
    frames = spread(len(copy), round(min(n_frames, len(copy))))
    times = copy.times[frames]
    poses = np.minimum(np.searchsorted(original.times, times), len(original) - 1)
    if not np.array_equal(original.times[poses], times, equal_nan=True):
        return None
    placed = tuple(
        _placed(copy, original, frame, pose)
        for frame, pose in zip(frames, poses.tolist(), strict=True)
    )
    if not all(each.residual <= FITS for each in placed):
        return None
    return MeshAlignment((copy,), original, IDENTITY, placed)


def _placed(copy: MeshAnimation, original: MeshAnimation, frame: int, pose: int) -> FramePlacement:
    there = original[pose]
    diagonal, centre = surface_box(there.points, there.faces)
    apart = lengths(copy[frame].points - there.points) / diagonal
    still = PolynomialMap.affine(np.eye(3), np.zeros(3), centre, diagonal)
    residual = float(np.sqrt((apart**2).mean()))
    return FramePlacement(frame, float(pose), {"similarity": still}, residual, 1.0)
