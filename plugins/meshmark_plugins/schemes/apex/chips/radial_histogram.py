"""Radial histograms: how vertices, and the surface itself, are spread over distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.geometry import face_areas
from meshmark.mesh.topology import boundary_edges
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField

# Cells a bin: fine enough that rounding to a cell costs a chip less than a hundredth.
CELLS_PER_BIN = 32
# Four points of a triangle, in barycentric coordinates, that stand for its area.
_THREE_POINTS = np.array([[1 / 3, 1 / 3, 1 / 3], [2 / 3, 1 / 6, 1 / 6], [1 / 6, 2 / 3, 1 / 6]])
TRIANGLE_SAMPLES: FloatArray = np.concatenate([_THREE_POINTS, [[1 / 6, 1 / 6, 2 / 3]]])
# Four points of an edge that stand for its length.
EDGE_SAMPLES: FloatArray = np.array([[7, 1], [5, 3], [3, 5], [1, 7]]) / 8


@dataclass(frozen=True, eq=False)
class RadialHistograms:
    """Radial histograms about several anchors, in cells of 1 / `CELLS_PER_BIN` of a bin.

    Parameters
    ----------
    weight, squared_weight : (C, B) float64
        Sum over the vertices in each cell of their weight, and of its square.
    area : (C, B) float64
        Area of the surface in each cell, in squares of the length scale of distances.
    border : (C, B) float64
        Length of the surface's border in each cell, in that length scale.
    """

    weight: FloatArray
    squared_weight: FloatArray
    area: FloatArray
    border: FloatArray

    def area_within(self, radii: FloatArray) -> FloatArray:
        """Area nearer to each anchor than some radii (G,), given in bins, (G, C)."""
        total = np.cumsum(np.pad(self.area, ((0, 0), (1, 0))), axis=1)
        ends = np.arange(total.shape[1]) / CELLS_PER_BIN
        return np.array([np.interp(radii, ends, row) for row in total]).T


def radial_histograms(
    field: GeodesicField, weights: FloatArray, width: float, n_cells: int
) -> RadialHistograms:
    """Sort the vertices and the area of a component by their distance from each anchor.

    Parameters
    ----------
    field : GeodesicField
        The component and its distances.
    weights : (n,) float64
        Weight of each vertex.
    width : float
        Width of a bin, in the length scale of distances.
    n_cells : int
        B; what lies farther away is left out.
    """
    V, F, H_surface = field.surface
    areas = face_areas(V, F) / field.length_scale**2
    sample_areas = np.repeat(areas / len(TRIANGLE_SAMPLES), len(TRIANGLE_SAMPLES))
    rim = boundary_edges(field.component.faces)
    lengths = np.linalg.norm(field.V[rim[:, 0]] - field.V[rim[:, 1]], axis=1) / field.length_scale
    sample_lengths = np.repeat(lengths / len(EDGE_SAMPLES), len(EDGE_SAMPLES))
    rows: list[tuple[FloatArray, ...]] = []
    for H, on_surface in zip(field.H, H_surface, strict=True):
        vertex_cells, area_cells, border_cells = (
            # What is far beyond the last cell would be beyond the integers, too.
            np.minimum(distances * (CELLS_PER_BIN / width), n_cells).astype(np.int64).ravel()
            for distances in (H, on_surface[F] @ TRIANGLE_SAMPLES.T, H[rim] @ EDGE_SAMPLES.T)
        )
        rows.append(
            (
                _histogram(vertex_cells, weights, n_cells),
                _histogram(vertex_cells, weights**2, n_cells),
                _histogram(area_cells, sample_areas, n_cells),
                _histogram(border_cells, sample_lengths, n_cells),
            )
        )
    return RadialHistograms(*(np.array(column) for column in zip(*rows, strict=True)))


def _histogram(cells: IntArray, values: FloatArray, n_cells: int) -> FloatArray:
    total = np.bincount(cells, values, n_cells + 1)
    return total[:n_cells].astype(np.float64, copy=False)
