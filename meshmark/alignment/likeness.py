"""How alike two assets are at a glance, before one is laid upon the other."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.geometry import face_areas, lengths

# Levels at which a distribution is compared, and frames of either that are looked at.
LEVELS, FRAMES = 33, 4


def signature(V: FloatArray, F: IntArray) -> FloatArray:
    """Measure how far a surface reaches from its centroid, whatever the similarity and the mesh.

    Parameters
    ----------
    V : (N, 3) float64
    F : (F, 3) int

    Returns
    -------
    (LEVELS,) float64
        Quantiles of the distance of the surface from its centroid, over the root of the mean of
        its square; zeros for a surface without area.

    Notes
    -----
    A shape distribution [1]_, by the centroids of triangles, weighted by area.

    References
    ----------
    .. [1] R. Osada, T. Funkhouser, B. Chazelle, D. Dobkin, "Shape distributions", ACM
       Transactions on Graphics 21(4), 2002, doi:10.1145/571647.571648.
    """
    area = face_areas(V, F)
    total = area.sum()
    if not np.isfinite(total) or total <= 0.0:
        return np.zeros(LEVELS)
    weight, places = area / total, V[F].mean(axis=1)
    distance = lengths(places - weight @ places)
    order = np.argsort(distance, kind="stable")
    reached = np.cumsum(weight[order]) - weight[order] / 2
    scale = np.sqrt(weight @ distance**2)
    if scale <= 0.0:
        return np.zeros(LEVELS)
    return np.interp((np.arange(LEVELS) + 0.5) / LEVELS, reached, distance[order] / scale)


def signatures(asset: Asset) -> list[FloatArray]:
    """Measure some frames of every mesh of an asset, (frames, LEVELS) each."""
    return [_of_frames(mesh) for mesh in asset.meshes]


def unlikeness(copy: Sequence[FloatArray], original: Sequence[FloatArray]) -> float:
    """Compare the signatures of two assets: 0 if every mesh of the copy is like one of the other.

    Of each mesh of the copy, the frame and the mesh of the original count that it is most like.
    """
    each = [min(_distance(mine, theirs) for theirs in original) for mine in copy]
    return float(np.mean(each))


def _of_frames(mesh: MeshAnimation) -> FloatArray:
    chosen = np.unique(np.linspace(0, len(mesh) - 1, FRAMES).round().astype(int))
    frames = [mesh[index] for index in chosen.tolist()]
    return np.array([signature(frame.points, frame.faces) for frame in frames])


def _distance(one: FloatArray, two: FloatArray) -> float:
    return min(float(np.abs(a - b).mean()) for a, b in product(one, two))
