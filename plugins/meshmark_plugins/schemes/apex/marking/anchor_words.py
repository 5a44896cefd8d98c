"""How the anchors of an animation are marked: in which units, with which words."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.mesh.animation import MeshAnimation
from meshmark.workers.ordered_map import ordered_map
from meshmark_plugins.schemes.apex.anchors.geodesic_field import GeodesicField, geodesic_fields
from meshmark_plugins.schemes.apex.chips.hypotheses import cells_needed
from meshmark_plugins.schemes.apex.chips.radial_histogram import profiles_of, vertex_weights
from meshmark_plugins.schemes.apex.chips.unit_series import phase_of, units
from meshmark_plugins.schemes.apex.chips.word_index import bulk, choose_words, place_of
from meshmark_plugins.schemes.apex.parameters import Tuning

# Frames whose bulks decide, by their median.
FRAMES = 5


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


def lay_out(animation: MeshAnimation, anchors: IntArray, tuning: Tuning, jobs: int) -> Layout:
    """Choose the unit and the word of each anchor (C,), in `jobs` worker processes.

    Raises
    ------
    CapacityError
        If distances cannot be measured.
    """
    first = animation[0]
    fields = geodesic_fields(first.points, first.faces, anchors)
    phase = np.array([phase_of(fields[0].reference_root_area)])
    unit = np.empty(len(anchors))
    for field in fields:
        unit[_rows(anchors, field.anchors)] = units(field.length_scale, phase)
    chosen = np.linspace(0, len(animation) - 1, min(FRAMES, len(animation))).round()
    find = _FindPlaces(animation, anchors, unit, tuning)
    places = list(ordered_map(find, np.unique(chosen).astype(int).tolist(), jobs=jobs))
    return Layout(anchors, unit, choose_words(np.median(places, axis=0)))


@dataclass(frozen=True, eq=False)
class _FindPlaces:
    """Finds the places of anchors in frame after frame; picklable, for worker processes."""

    animation: MeshAnimation
    anchors: IntArray
    unit: FloatArray
    tuning: Tuning

    def __call__(self, index: int) -> FloatArray:
        frame, tuning = self.animation[index], self.tuning
        places = np.empty(len(self.anchors))
        for field in geodesic_fields(frame.points, frame.faces, self.anchors):
            rows = _rows(self.anchors, field.anchors)
            weights = vertex_weights(field, tuning.width)
            n_cells = cells_needed(tuning.bins, tuning.width)
            profiles = profiles_of(field, weights, tuning.width, n_cells)
            of_units = bulk(profiles, tuning.width, 1.0 / self.unit[rows[:1]])
            places[rows] = place_of(of_units)[0]
        return places


def _rows(anchors: IntArray, some: IntArray) -> IntArray:
    """Place in `anchors` of some of them."""
    return np.array([int(np.flatnonzero(anchors == vertex)[0]) for vertex in some])
