"""How far the surface slid under its own texture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import UsageError
from meshmark.mesh.charts import Charts
from meshmark.mesh.closest_in_triangle import plane_weights
from meshmark.mesh.closest_points import ClosestPoints

# Width of the map that a drift is told in, where nothing else is known: what film calls 4k.
TEXELS = 4096

# Returns the coordinates (N, 2) or (F, 3, 2) at a time; None without any.
Coordinates = Callable[[float], FloatArray | None]


@dataclass(eq=False)
class Texture:
    """The texture coordinates of an animation before and after marking.

    Parameters
    ----------
    before : (N, 2) or (F, 3, 2) float64, or callable, or None
        Those of all frames, or what returns them for a time.
    after : callable or None
        What returns those after; None if they are the same.
    """

    before: FloatArray | Coordinates | None
    after: Coordinates | None = None
    _known: tuple[FloatArray, Charts] | None = field(default=None, init=False, repr=False)

    def largest_drift(self, time: float, V0: FloatArray, V1: FloatArray, F: IntArray) -> float:
        """Measure how far the farthest vertex of a frame slid, in texels; NaN if unknown."""
        UV = self.before(time) if callable(self.before) else self.before
        UV1 = UV if self.after is None else self.after(time)
        if UV is None or UV1 is None:
            return math.nan
        if self.after is None:
            return float(texture_drift(V0, V1, F, UV).max())
        both = (by_corner(coordinates, V0, F) for coordinates in (UV, UV1))
        return self._followed(V0, V1, F, *both)

    def _followed(
        self, V0: FloatArray, V1: FloatArray, F: IntArray, UV: FloatArray, UV1: FloatArray
    ) -> float:
        if self._known is None or not np.array_equal(self._known[0], UV):
            self._known = UV, Charts.of_corners(F, UV)
        return float(followed_drift(V0, V1, self._known[1], UV, UV1).max())


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
    corner_uv = by_corner(UV, V0, F)
    drift = np.zeros(len(V0))
    used = np.zeros(len(V0), dtype=bool)
    used[F] = True
    moved = np.flatnonzero(used & np.any(V0 != V1, axis=1))
    if moved.size == 0:
        return drift
    face, weights = ClosestPoints(V0, F).find(V1[moved])
    there = np.einsum("ij,ijk->ik", weights, corner_uv[face])
    own = _from_own_corners(there, moved, F, corner_uv)
    continued = _from_continued_chart(there, V0[moved], V0[F[face]], corner_uv[face])
    drift[moved] = texels * np.minimum(own, continued)
    return drift


def followed_drift(
    V0: FloatArray,
    V1: FloatArray,
    charts: Charts,
    UV: FloatArray,
    UV1: FloatArray,
    *,
    texels: int = TEXELS,
) -> FloatArray:
    """Measure how far each vertex slid under texture coordinates that changed, in texels.

    Parameters
    ----------
    V0, V1 : (N, 3) float64
        Vertex positions before and after.
    charts : Charts
        Those of the coordinates before; see `Charts.of_corners`.
    UV, UV1 : (F, 3, 2) float64
        Texture coordinates of the triangles' corners before and after.
    texels : int
        As in `texture_drift`.

    Returns
    -------
    (N,) float64
        0 for a vertex that did not move or is used by no face.

    Notes
    -----
    As in `texture_drift`, the new place is the closest point of the original surface, and a seam
    between is no drift. So where that is less, the coordinates are compared with those of the
    nearest of the vertex's own faces, continued beyond its edges, or of its own chart, continued
    beyond its own.
    """
    drift = np.zeros(len(V0))
    places = charts.places(V0, V1)
    if places.rows.size == 0:
        return drift
    before, after = (charts.of_rows(coordinates) for coordinates in (UV, UV1))
    rows, vertex = places.rows, charts.vertices[places.rows]
    face, weights = ClosestPoints(V0, charts.faces).find(V1[vertex])
    own = charts.nearest(V0, V1, rows)
    own_weights, flat = plane_weights(V1[vertex], *(V0[v] for v in charts.faces[own].T))
    readings = [
        np.einsum("ij,ijk->ik", weights, UV[face]),
        np.where(flat[:, None], np.inf, np.einsum("ij,ijk->ik", own_weights, UV[own])),
        np.where(places.beyond[:, None], places.values(before, continued=True)[rows], np.inf),
    ]
    off = [np.linalg.norm(reading - after[rows], axis=1) for reading in readings]
    drift[vertex] = np.inf
    np.minimum.at(drift, vertex, texels * np.min(off, axis=0))
    return drift


def by_corner(UV: FloatArray, V: FloatArray, F: IntArray) -> FloatArray:
    """Return texture coordinates of vertices (N, 2) or corners (F, 3, 2) as those of corners.

    Raises
    ------
    UsageError
        If they are neither.
    """
    if UV.shape not in ((len(V), 2), (len(F), 3, 2)):
        raise UsageError(
            f"texture coordinates {UV.shape} fit neither {len(V)} points nor {len(F)} triangles"
        )
    return UV[F] if UV.ndim == 2 else UV


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
