"""The anchors of an animation as they are marked: in which units, with which words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.workers.ordered_map import ordered_map
from meshmark_plugins.schemes.apex.anchors.geodesic_field import (
    GeodesicField,
    anchored_components,
    geodesic_fields,
)
from meshmark_plugins.schemes.apex.anchors.proxies import Proxies
from meshmark_plugins.schemes.apex.chips.radial_histogram import radial_histograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import cells_needed
from meshmark_plugins.schemes.apex.chips.soft_chips import MIN_VERTEX_COUNT, measure_chips
from meshmark_plugins.schemes.apex.chips.unit_series import nearest_residue, relative_units
from meshmark_plugins.schemes.apex.chips.whitening import whitening_weights
from meshmark_plugins.schemes.apex.chips.word_index import (
    choose_words,
    geodesic_disc_areas,
    word_position,
)
from meshmark_plugins.schemes.apex.parameters import Parameters

# Frames whose disc areas decide on words, by their median.
WORD_FRAMES = 5


@dataclass(frozen=True, eq=False)
class MarkedAnchors:
    """Anchors with the units and the words of their marks.

    Parameters
    ----------
    vertices : (C,) int
        The anchors.
    units : (C,) float64
        Unit of length about each anchor, in root areas of its component, in every pose.
    words : (C,) int
        Word of each anchor, a row of the key's.
    """

    vertices: IntArray
    units: FloatArray
    words: IntArray

    def fields(
        self,
        V: FloatArray,
        F: IntArray,
        label: IntArray | None = None,
        proxies: Proxies | None = None,
    ) -> list[tuple[IntArray, GeodesicField]]:
        """Measure distances in root areas, by component; with which of the anchors each has.

        Parameters are those of `geodesic_fields`.
        """
        fields = geodesic_fields(V, F, self.vertices, label, proxies)
        return [(_rows(self.vertices, field.anchors), field) for field in fields]


def assign_units_and_words(
    animation: MeshAnimation,
    vertices: IntArray,
    parameters: Parameters,
    jobs: int,
    proxies: Proxies | None = None,
) -> MarkedAnchors:
    """Choose the unit and the word of each anchor (C,), in `jobs` worker processes.

    Raises
    ------
    CapacityError
        If distances cannot be measured.
    """
    first = animation[0]
    units = np.empty(len(vertices))
    for each in anchored_components(first.points, first.faces, vertices):
        own, largest = each.root_areas
        rows = _rows(vertices, each.component.vertices[each.anchors])
        units[rows] = relative_units(own, np.array([nearest_residue(largest)]))
    chosen = np.linspace(0, len(animation) - 1, min(WORD_FRAMES, len(animation))).round()
    find = _FindPositions(animation, vertices, units, parameters, proxies)
    positions = list(ordered_map(find, np.unique(chosen).astype(int).tolist(), jobs=jobs))
    return MarkedAnchors(vertices, units, choose_words(np.median(positions, axis=0)))


@dataclass(frozen=True, eq=False)
class _FindPositions:
    """Finds the positions of anchors in the list of words, frame after frame; picklable."""

    animation: MeshAnimation
    vertices: IntArray
    units: FloatArray
    parameters: Parameters
    proxies: Proxies | None

    def __call__(self, index: int) -> FloatArray:
        frame, K, width = self.animation[index], self.parameters.bins, self.parameters.width
        positions = np.empty(len(self.vertices))
        for field in geodesic_fields(
            frame.points, frame.faces, self.vertices, proxies=self.proxies
        ):
            rows = _rows(self.vertices, field.anchors)
            weights = whitening_weights(field, width)
            histograms = radial_histograms(field, weights, width, cells_needed(K, width))
            areas = geodesic_disc_areas(histograms, width, 1.0 / self.units[rows[:1]])
            positions[rows] = word_position(areas)[0]
        return positions


def field_chips(
    field: GeodesicField, unit: float, n_bins: int, width: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Measure the chips about the anchors of a component as they are marked.

    Parameters
    ----------
    field : GeodesicField
        In root areas.
    unit : float
        The unit of its marks, in root areas.
    n_bins : int
        K.
    width : float
        Width of a bin, in units.

    Returns
    -------
    s, n : (C, K) float64
        Chips, and the effective number of vertices of each.
    weights : (n,) float64
        Whitening weights of the component's vertices.
    """
    weights = whitening_weights(field, width)
    n_cells = cells_needed(n_bins, width)
    histograms = radial_histograms(field.rescaled(unit), weights, width, n_cells)
    s, n = measure_chips(histograms, n_bins, np.ones(1), np.zeros(1))
    return s[0], n[0], weights


def count_usable_chips(
    V: FloatArray,
    F: IntArray,
    anchors: MarkedAnchors,
    parameters: Parameters,
    proxies: Proxies | None = None,
) -> int:
    """Count the chips of a mesh that are no erasures."""
    usable = 0
    for rows, field in anchors.fields(V, F, proxies=proxies):
        unit = float(anchors.units[rows[0]])
        _, n, _ = field_chips(field, unit, parameters.bins, parameters.width)
        usable += int(np.count_nonzero(n >= MIN_VERTEX_COUNT))
    return usable


def _rows(anchors: IntArray, some: IntArray) -> IntArray:
    """Index in `anchors` of some of them."""
    return np.array([int(np.flatnonzero(anchors == vertex)[0]) for vertex in some])
