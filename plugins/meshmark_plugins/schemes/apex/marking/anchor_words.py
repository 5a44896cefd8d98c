"""How the anchors of an animation are marked: in which units, with which words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.workers.ordered_map import ordered_map
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField, geodesic_fields
from meshmark_plugins.schemes.apex.chips.radial_histogram import radial_histograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import cells_needed
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
class Layout:
    """What marking and its measurements share.

    Parameters
    ----------
    anchors : (C,) int
        Vertices.
    units : (C,) float64
        Unit of length about each anchor, in root areas of its piece, in every pose.
    words : (C,) int
        Word of each anchor, a row of the key's.
    """

    anchors: IntArray
    units: FloatArray
    words: IntArray

    def measured(
        self, V: FloatArray, F: IntArray, label: IntArray | None = None
    ) -> list[tuple[IntArray, GeodesicField]]:
        """Measure from the anchors in root areas, piece by piece; with which of them each has.

        Parameters are those of `geodesic_fields`.
        """
        fields = geodesic_fields(V, F, self.anchors, label)
        return [(_rows(self.anchors, field.anchors), field) for field in fields]


def lay_out(
    animation: MeshAnimation, anchors: IntArray, parameters: Parameters, jobs: int
) -> Layout:
    """Choose the unit and the word of each anchor (C,), in `jobs` worker processes.

    Raises
    ------
    CapacityError
        If distances cannot be measured.
    """
    first = animation[0]
    fields = geodesic_fields(first.points, first.faces, anchors)
    residue = np.array([nearest_residue(fields[0].reference_root_area)])
    unit = np.empty(len(anchors))
    for field in fields:
        unit[_rows(anchors, field.anchors)] = relative_units(field.length_scale, residue)
    chosen = np.linspace(0, len(animation) - 1, min(WORD_FRAMES, len(animation))).round()
    find = _FindPositions(animation, anchors, unit, parameters)
    positions = list(ordered_map(find, np.unique(chosen).astype(int).tolist(), jobs=jobs))
    return Layout(anchors, unit, choose_words(np.median(positions, axis=0)))


@dataclass(frozen=True, eq=False)
class _FindPositions:
    """Finds the positions of anchors in the list of words, frame after frame; picklable."""

    animation: MeshAnimation
    anchors: IntArray
    unit: FloatArray
    parameters: Parameters

    def __call__(self, index: int) -> FloatArray:
        frame, parameters = self.animation[index], self.parameters
        positions = np.empty(len(self.anchors))
        for field in geodesic_fields(frame.points, frame.faces, self.anchors):
            rows = _rows(self.anchors, field.anchors)
            weights = whitening_weights(field, parameters.width)
            n_cells = cells_needed(parameters.bins, parameters.width)
            histograms = radial_histograms(field, weights, parameters.width, n_cells)
            areas = geodesic_disc_areas(histograms, parameters.width, 1.0 / self.unit[rows[:1]])
            positions[rows] = word_position(areas)[0]
        return positions


def _rows(anchors: IntArray, some: IntArray) -> IntArray:
    """Place in `anchors` of some of them."""
    return np.array([int(np.flatnonzero(anchors == vertex)[0]) for vertex in some])
