"""The built-in schemes by the suite that third parties' schemes are held to."""

from __future__ import annotations

import pytest

from meshmark.plugins import catalogue
from meshmark.recipe import DEFAULT_GEODESIC, DEFAULT_SEGMENTER, Recipe, SolverFactory
from meshmark.testing import SchemeSuite
from meshmark.testing.schemes import swaying


class BuiltInSuite(SchemeSuite):
    """A scheme by its name, with the default segmenter and solver."""

    name: str

    @pytest.fixture
    def scheme(self):
        return Recipe(self.name).build()

    @pytest.fixture
    def record(self):
        return catalogue().find("scheme", self.name).record

    @pytest.fixture
    def parts(self):
        segmenter = catalogue().make("segmenter", DEFAULT_SEGMENTER)
        return {"segmenter": segmenter, "solver": SolverFactory(DEFAULT_GEODESIC, {})}


class TestTsai2014(BuiltInSuite):
    name = "tsai2014"


class TestCho2007(BuiltInSuite):
    name = "cho2007"

    @pytest.fixture
    def animation(self, creature):
        return creature.select([0, 8, 16])


def backwards(scheme):
    """Return the scheme with its moves turned round."""
    move = scheme.move
    scheme.move = lambda frame, layout, carriers, shifts, rng: move(
        frame, layout, carriers, [-shift for shift in shifts], rng
    )
    return scheme


def test_the_suite_sees_moves_that_go_the_wrong_way() -> None:
    suite, frame = SchemeSuite(), swaying(1)[0]
    suite.test_moves_change_chips_as_asked(Recipe("cho2007").build(), frame)
    with pytest.raises(AssertionError):
        suite.test_moves_change_chips_as_asked(backwards(Recipe("cho2007").build()), frame)


def test_the_suite_sees_a_mark_that_cannot_be_found() -> None:
    with pytest.raises(AssertionError):
        SchemeSuite().test_a_mark_is_found_blindly_by_its_key_alone(
            backwards(Recipe("cho2007").build()), swaying(2), -3.0
        )
