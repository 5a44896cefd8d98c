"""How far the surface slid under its own texture."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import UsageError
from meshmark.mesh.closest_points import ClosestPoints, plane_weights

# Width of the map that a drift is told in, where nothing else is known: what film calls 4k.
TEXELS = 4096


def texture_drift(
    V0: FloatArray, V1: FloatArray, F: IntArray, UV: FloatArray, *, texels: int = TEXELS
) -> FloatArray:
    """Measure how far each vertex slid under its own texture coordinates, in texels.

    A vertex that slides along the surface takes its texture coordinates with it, and with them
    the picture. The original surface at its new place has other coordinates; the difference
    is how far the picture moved. A move straight out of the surface costs nothing.

    Parameters
    ----------
    V0, V1 : (N, 3) float64
        Vertex positions before and after.
    F : (F, 3) int
        Triangles.
    UV : (N, 2) or (F, 3, 2) float64
        Texture coordinates of the vertices, or of the corners of each triangle.
    texels : int
        Width and height of the map that u and v from 0 to 1 run over.

    Returns
    -------
    (N,) float64
        0 for a vertex that did not move or is used by no face.

    Raises
    ------
    UsageError
        If the coordinates fit neither the vertices nor the corners.

    Notes
    -----
    The new place is the closest point of the original surface. Coordinates jump at the seams
    of an atlas, and a vertex that slid across one did not slide across the atlas: where that
    is less, the vertex's old place in the chart of the face it slid into is taken instead, by
    continuing that face's coordinates beyond its edges.
    """
    if UV.shape not in ((len(V0), 2), (len(F), 3, 2)):
        raise UsageError(
            f"texture coordinates {UV.shape} fit neither {len(V0)} points nor {len(F)} triangles"
        )
    drift = np.zeros(len(V0))
    used = np.zeros(len(V0), dtype=bool)
    used[F] = True
    moved = np.flatnonzero(used & np.any(V0 != V1, axis=1))
    if moved.size == 0:
        return drift
    corner_uv = UV[F] if UV.ndim == 2 else UV
    face, weights = ClosestPoints(V0, F).find(V1[moved])
    there = np.einsum("ij,ijk->ik", weights, corner_uv[face])
    own = _from_own_corners(there, moved, F, corner_uv)
    continued = _from_continued_chart(there, V0[moved], V0[F[face]], corner_uv[face])
    drift[moved] = texels * np.minimum(own, continued)
    return drift


def _from_own_corners(
    there: FloatArray, moved: IntArray, F: IntArray, corner_uv: FloatArray
) -> FloatArray:
    """Distance to the nearest of the coordinates each moved vertex has, one for each chart."""
    slot = np.full(int(F.max()) + 1, -1)
    slot[moved] = np.arange(len(moved))
    corner = slot[F.reshape(-1)]
    uv = corner_uv.reshape(-1, 2)[corner >= 0]
    corner = corner[corner >= 0]
    nearest = np.full(len(moved), np.inf)
    np.minimum.at(nearest, corner, np.linalg.norm(there[corner] - uv, axis=1))
    return nearest


def _from_continued_chart(
    there: FloatArray, P: FloatArray, corners: FloatArray, uv: FloatArray
) -> FloatArray:
    """Distance to where the old places P lie in the charts of the faces; inf without area."""
    weights, flat = plane_weights(P, corners[:, 0], corners[:, 1], corners[:, 2])
    here = np.einsum("ij,ijk->ik", weights, uv)
    return np.where(flat, np.inf, np.linalg.norm(there - here, axis=1))
