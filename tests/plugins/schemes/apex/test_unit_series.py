"""Units of length that a copy remembers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from meshmark_plugins.schemes.apex.chips.unit_series import (
    LOWEST_STEP,
    SERIES_PERIOD,
    nearest_residue,
    ratio_to_steps,
    relative_units,
    steps_to_ratio,
)

LENGTHS = st.floats(1e-4, 1e4)


@given(LENGTHS)
def test_the_unit_is_the_nearest_member_of_the_series(root_area):
    unit = relative_units(root_area, np.array([nearest_residue(root_area)]))
    assert np.abs(ratio_to_steps(unit)).max() <= 0.5 + 1e-9
    # A member: a whole number of steps from 1.
    steps = ratio_to_steps(unit * root_area)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


@given(LENGTHS, st.floats(0.36, 1.05))
def test_what_is_left_of_a_component_remembers_its_unit(root_area, share):
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


def test_steps_and_ratios_undo_each_other():
    np.testing.assert_allclose(
        ratio_to_steps(steps_to_ratio(np.array([-1.0, 0.0, 2.5]))), [-1.0, 0.0, 2.5]
    )
