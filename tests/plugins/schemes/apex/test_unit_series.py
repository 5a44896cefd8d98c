"""Units of length that a copy remembers, and words told by disc areas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from meshmark.mesh.animation import MeshAnimation
from meshmark.testing.meshes import capsule, icosphere, side_by_side
from meshmark_plugins.schemes.apex.anchors.components import (
    large_components,
    reference_root_area,
    shared_root_areas,
)
from meshmark_plugins.schemes.apex.anchors.geodesic_field import DISC_RADIUS, geodesic_fields
from meshmark_plugins.schemes.apex.chips.radial_histogram import radial_histograms
from meshmark_plugins.schemes.apex.chips.scale_hypotheses import cells_needed
from meshmark_plugins.schemes.apex.chips.unit_series import (
    LOWEST_STEP,
    SERIES_PERIOD,
    nearest_residue,
    ratio_to_steps,
    relative_units,
    steps_to_ratio,
)
from meshmark_plugins.schemes.apex.chips.whitening import whitening_weights
from meshmark_plugins.schemes.apex.chips.word_index import (
    LOG_AREA_STEP,
    N_WORDS,
    choose_words,
    geodesic_disc_areas,
    word_position,
)
from meshmark_plugins.schemes.apex.marking.marked_anchors import assign_units_and_words
from meshmark_plugins.schemes.apex.parameters import Parameters

PARAMETERS = Parameters(16, 0.04, 8, 0.36, 2.2e-4, 8)
LENGTHS = st.floats(1e-4, 1e4)


@given(LENGTHS)
def test_the_unit_is_the_nearest_member_of_the_series(root_area):
    unit = relative_units(root_area, np.array([nearest_residue(root_area)]))
    assert np.abs(ratio_to_steps(unit)).max() <= 0.5 + 1e-9
    # A member: a whole number of steps from 1.
    steps = ratio_to_steps(unit * root_area)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


@given(LENGTHS, st.floats(0.36, 1.05))
def test_what_is_left_of_a_piece_remembers_its_unit(root_area, share):
    residue = np.array([nearest_residue(root_area)])
    unit = relative_units(root_area, residue) * root_area
    rest = root_area * np.sqrt(share)
    # As long as it is one of those in question.
    assume(
        LOWEST_STEP + 0.01
        < float(ratio_to_steps(unit / rest)[0])
        < LOWEST_STEP + SERIES_PERIOD - 0.01
    )
    np.testing.assert_allclose(relative_units(rest, residue) * rest, unit, rtol=1e-9)


@pytest.mark.parametrize("factor", [1e-3, 0.01, 100.0, 1e6])
def test_metres_or_centimetres_make_no_difference(factor):
    for root_area in (0.3, 1.65, 2.27, 7.1):
        assert nearest_residue(factor * root_area) == nearest_residue(root_area)
        residues = np.arange(float(SERIES_PERIOD))
        np.testing.assert_allclose(
            relative_units(factor * root_area, residues),
            relative_units(root_area, residues),
            rtol=1e-9,
        )


def test_scale_and_members_undo_each_other():
    np.testing.assert_allclose(
        ratio_to_steps(steps_to_ratio(np.array([-1.0, 0.0, 2.5]))), [-1.0, 0.0, 2.5]
    )


def without_top(V, F, height):
    below = F[(V[F, 2] < height).all(axis=1)]
    kept, faces = np.unique(below, return_inverse=True)
    return V[kept], faces.reshape(-1, 3)


def test_open_pieces_and_the_largest_share_a_length_and_closed_ones_have_their_own():
    large, small = capsule(24, 60), capsule(20, 50, 0.2, 2.0)
    V, F = side_by_side(large, (small[0] + 5.0, small[1]))
    own = shared_root_areas(V, large_components(V, F))
    assert own[0] > 1.4 * own[1]
    cut = without_top(*small, 0.5)
    V, F = side_by_side(large, (cut[0] + 5.0, cut[1]))
    shared = shared_root_areas(V, large_components(V, F))
    assert shared[0] == shared[1] == reference_root_area(V, F) > own[0]


def test_a_disc_area_is_the_area_about_an_anchor_in_squared_units():
    V, F = icosphere(5)
    (field,) = geodesic_fields(V, F, np.array([0]))
    histograms = radial_histograms(
        field, whitening_weights(field, 0.04), 0.04, cells_needed(16, 0.04)
    )
    scales = np.array([1.0, 0.8])
    found = geodesic_disc_areas(histograms, 0.04, scales)[:, 0]
    # Archimedes: a cap of height h has the area 2 pi r h; root area 1 is a radius of .2821.
    r = 1.0 / np.sqrt(4.0 * np.pi)
    cap = 2.0 * np.pi * r**2 * (1.0 - np.cos(DISC_RADIUS / scales / r)) * scales**2
    np.testing.assert_allclose(found, cap, rtol=0.01)


def test_positions_go_with_the_logarithm_of_the_disc_area_and_words_are_the_nearest():
    positions = word_position(np.array([0.04, 0.04 * np.exp(LOG_AREA_STEP), 0.0, 1e9]))
    assert positions[1] - positions[0] == pytest.approx(1.0)
    assert positions[2] == 0.0
    assert positions[3] == N_WORDS - 1.0
    assert choose_words(np.array([20.2, 7.9, 33.4])).tolist() == [20, 8, 33]
    crowded = choose_words(np.array([20.0, 20.0, 20.1, 20.2]))
    assert len(set(crowded.tolist())) == 4
    assert np.abs(crowded - 20).max() <= 2


def test_every_anchor_is_given_a_unit_and_a_word_of_its_own():
    V, F = capsule(48, 100, 0.6)
    animation = MeshAnimation.from_arrays(V[None], F)
    vertices = np.array([len(V) - 1, len(V) - 2])
    anchors = assign_units_and_words(animation, vertices, PARAMETERS, 1)
    assert anchors.vertices is vertices
    length = reference_root_area(V, F)
    np.testing.assert_allclose(
        anchors.units, relative_units(length, np.array([nearest_residue(length)]))[0]
    )
    # Both ends are alike: neighbouring words.
    assert abs(int(anchors.words[0]) - int(anchors.words[1])) == 1
    ((rows, field),) = anchors.fields(V, F)
    np.testing.assert_array_equal(vertices[rows], field.anchors)
