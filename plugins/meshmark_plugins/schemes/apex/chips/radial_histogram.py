"""Radial profiles: how vertices, and the surface itself, are spread over distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.topology import boundary_edges
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField
from meshmark_plugins.schemes.apex.chips.whitening import whitening

# Cells a bin: fine enough that rounding to a cell costs a chip less than a hundredth.
CELLS = 32
# Four points of a triangle, in barycentric coordinates, that stand for its area.
_SPREAD = np.array([[1 / 3, 1 / 3, 1 / 3], [2 / 3, 1 / 6, 1 / 6], [1 / 6, 2 / 3, 1 / 6]])
SPREAD: FloatArray = np.concatenate([_SPREAD, [[1 / 6, 1 / 6, 2 / 3]]])
# Four points of an edge that stand for its length.
ALONG: FloatArray = np.array([[7 / 8, 1 / 8], [5 / 8, 3 / 8], [3 / 8, 5 / 8], [1 / 8, 7 / 8]])


@dataclass(frozen=True, eq=False)
class Profiles:
    """Radial profiles about several anchors, in cells of 1 / `CELLS` of a bin.

    Parameters
    ----------
    weight, square : (C, B) float64
        Sum over the vertices in each cell of their weight, and of its square.
    area : (C, B) float64
        Area of the surface in each cell, in squares of the unit of distance.
    border : (C, B) float64
        Length of the surface's border in each cell, in the unit of distance.
    """

    weight: FloatArray
    square: FloatArray
    area: FloatArray
    border: FloatArray

    def area_within(self, radii: FloatArray) -> FloatArray:
        """Area nearer to each anchor than some radii (G,), given in bins, (G, C)."""
        total = np.cumsum(np.pad(self.area, ((0, 0), (1, 0))), axis=1)
        ends = np.arange(total.shape[1]) / CELLS
        return np.array([np.interp(radii, ends, row) for row in total]).T


def vertex_weights(field: GeodesicField, width: float) -> FloatArray:
    """Whitening weights of a piece's vertices, (n,), on the scale of half a bin."""
    return whitening(field.V, field.component.faces, field.length_scale, width / 2.0)


def profiles_of(field: GeodesicField, weights: FloatArray, width: float, n_cells: int) -> Profiles:
    """Sort the vertices and the area of a piece by their distance from each anchor.

    Parameters
    ----------
    field : Neighbourhood
        The piece and its distances.
    weights : (n,) float64
        Weight of each vertex.
    width : float
        Width of a bin, in the unit of distance.
    n_cells : int
        B; what lies farther away is left out.
    """
    F = field.component.faces
    areas = face_areas(field.V, F) / field.length_scale**2
    quarter = np.repeat(areas / len(SPREAD), len(SPREAD))
    rim = boundary_edges(F)
    lengths = np.linalg.norm(field.V[rim[:, 0]] - field.V[rim[:, 1]], axis=1) / field.length_scale
    quarters = np.repeat(lengths / len(ALONG), len(ALONG))
    rows: list[tuple[FloatArray, ...]] = []
    for H in field.H:
        own, spread, along = (
            # What is far beyond the last cell would be beyond the integers, too.
            np.minimum(distances * (CELLS / width), n_cells).astype(np.int64).ravel()
            for distances in (H, H[F] @ SPREAD.T, H[rim] @ ALONG.T)
        )
        rows.append(
            (
                _histogram(own, weights, n_cells),
                _histogram(own, weights**2, n_cells),
                _histogram(spread, quarter, n_cells),
                _histogram(along, quarters, n_cells),
            )
        )
    return Profiles(*(np.array(column) for column in zip(*rows, strict=True)))


def _histogram(cells: IntArray, values: FloatArray, n_cells: int) -> FloatArray:
    total = np.bincount(cells, values, n_cells + 1)
    return total[:n_cells].astype(np.float64, copy=False)
