"""The built-in schemes by the suite that third parties' schemes are held to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.extension.carrier import Observation
from meshmark.extension.defaults import DEFAULT_GEODESIC, DEFAULT_SEGMENTER
from meshmark.extension.informed import InformedScheme, signs_of
from meshmark.extension.interfaces import BinnedScheme, Scheme
from meshmark.extension.recipe import Recipe, SolverFactory
from meshmark.extension.registry import catalogue
from meshmark.testing import BinnedSchemeSuite, InformedSchemeSuite, SchemeSuite
from meshmark.testing.any_scheme import NAME, OTHER
from meshmark.testing.binned_schemes import swaying
from meshmark.testing.informed_schemes import assert_rare, horned
from meshmark.testing.schemes import analysed, assert_alike, galloping


def binned(name: str) -> BinnedScheme:
    """Return a binned scheme as its plugin makes it."""
    return Recipe(name).build().binned


class BuiltIn:
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


class BuiltInBinned(BuiltIn):
    """A binned scheme by its name."""

    @pytest.fixture
    def scheme(self):
        return binned(self.name)


class TestTsai2014(BuiltInBinned, BinnedSchemeSuite):
    name = "tsai2014"


class TestCho2007(BuiltInBinned, BinnedSchemeSuite):
    name = "cho2007"

    @pytest.fixture
    def animation(self, creature):
        return creature.select([0, 8, 16])


class TestApex(BuiltIn, SchemeSuite):
    name = "apex"

    @pytest.mark.slow
    def test_equal_keys_give_equal_marks_by_any_number_of_workers(self, scheme, animation):
        super().test_equal_keys_give_equal_marks_by_any_number_of_workers(scheme, animation)

    @pytest.fixture
    def tolerance(self):
        return 1e-9


class TestRelief(BuiltIn, InformedSchemeSuite):
    name = "relief"


def backwards(scheme):
    """Return the scheme with its moves turned round."""
    move = scheme.move
    scheme.move = lambda frame, layout, carriers, shifts, rng: move(
        frame, layout, carriers, [-shift for shift in shifts], rng
    )
    return scheme


def test_the_suite_of_binned_schemes_sees_moves_that_go_the_wrong_way() -> None:
    suite, frame = BinnedSchemeSuite(), swaying(1)[0]
    suite.test_moves_change_chips_as_asked(binned("cho2007"), frame)
    with pytest.raises(AssertionError):
        suite.test_moves_change_chips_as_asked(backwards(binned("cho2007")), frame)


def test_the_suite_of_binned_schemes_sees_a_mark_that_cannot_be_found() -> None:
    with pytest.raises(AssertionError):
        BinnedSchemeSuite().test_a_mark_is_found_blindly_by_its_key_alone(
            backwards(binned("cho2007")), swaying(2), -3.0
        )


def seeing(look) -> Scheme:
    """Return apex with its observations of a frame changed."""
    scheme = Recipe("apex").build()
    observe = scheme.observe
    scheme.observe = lambda frame, reference=None: look(observe(frame, reference), frame)
    return scheme


def overconfident(observation, frame) -> Observation:
    return replace(observation, log_prior=observation.log_prior + 0.01)


def listening_to_order(observation, frame) -> Observation:
    return replace(observation, soft=observation.soft * np.cos(frame.faces[0, 0]))


def listening_to_place(observation, frame) -> Observation:
    return replace(observation, soft=observation.soft * np.cos(frame.points[0, 0]))


def test_the_suite_of_schemes_sees_evidence_that_is_not_of_the_shape_alone() -> None:
    suite, frame = SchemeSuite(), analysed(galloping())[0]
    with pytest.raises(AssertionError, match="Not equal to tolerance"):
        suite.test_order_changes_nothing(seeing(listening_to_order), frame, 1e-6)
    with pytest.raises(AssertionError, match="Not equal to tolerance"):
        suite.test_similarity_changes_nothing(seeing(listening_to_place), frame, 1e-6, 1e3)


def test_the_suite_of_schemes_sees_more_belief_than_there_is() -> None:
    with pytest.raises(AssertionError):
        SchemeSuite().test_sightings_are_sound(seeing(overconfident), galloping())


def test_the_suite_of_schemes_sees_a_mark_that_cannot_be_found() -> None:
    suite, one = SchemeSuite(), galloping().select([0])
    scheme = Recipe("apex").build()
    suite.test_a_mark_is_found_blindly_by_its_key_alone(scheme, one, -6.0)
    plan, words = scheme.plan, OTHER.words(NAME, scheme.n_words, scheme.n_chips)
    scheme.plan = lambda animation, _, **given: plan(animation, words, **given)
    with pytest.raises(AssertionError):
        suite.test_a_mark_is_found_blindly_by_its_key_alone(scheme, one, -6.0)


def looking(look) -> InformedScheme:
    """Return relief with what it sees in a view changed."""
    scheme = Recipe("relief").build()
    measure, observe = scheme.measure, scheme.observe
    scheme.measure = lambda view, *others: (view, measure(view, *others))
    scheme.observe = lambda measured, layout: [
        look(seen, view)
        for (view, _), seen in zip(
            measured, observe([found for _, found in measured], layout), strict=True
        )
    ]
    return scheme


def test_the_suite_of_informed_schemes_sees_evidence_out_of_range() -> None:
    suite, frame = InformedSchemeSuite(), analysed(horned())[0]
    with pytest.raises(AssertionError):
        suite.test_sightings_are_sound(looking(overconfident), frame)
    with pytest.raises(AssertionError):
        suite.test_sightings_are_sound(
            looking(lambda seen, _: replace(seen, soft=1.1 * np.ones_like(seen.soft))), frame
        )


def test_the_suite_of_informed_schemes_sees_evidence_that_hangs_on_the_order() -> None:
    suite, frame = InformedSchemeSuite(), analysed(horned())[0]
    by_order = looking(lambda seen, view: replace(seen, soft=seen.soft * np.cos(view.points[0, 0])))
    with pytest.raises(AssertionError, match="Not equal to tolerance"):
        suite.test_order_changes_nothing(by_order, frame, 1e-6)


def test_the_suite_of_informed_schemes_sees_a_mark_that_cannot_be_found() -> None:
    scheme = Recipe("relief").build()
    plan = scheme.plan
    scheme.plan = lambda animation, layout, signs, *, jobs: plan(
        animation, layout, signs_of(OTHER, NAME, layout, None), jobs=jobs
    )
    suite, one = InformedSchemeSuite(), horned().select([0])
    with pytest.raises(AssertionError):
        suite.test_a_mark_is_found_beside_the_original_by_its_key_alone(scheme, one, -6.0)


def test_the_suite_of_informed_schemes_sees_that_too_many_random_words_fit() -> None:
    assert_rare(np.log10(np.linspace(1e-3, 1.0, 1000)), (0.1, 0.01))
    with pytest.raises(AssertionError):
        assert_rare(np.log10(np.linspace(1e-3, 0.5, 1000)), (0.1, 0.01))


def test_carriers_may_stand_in_another_order_but_not_elsewhere() -> None:
    rng = np.random.default_rng(0)
    soft, order = rng.uniform(-1, 1, size=(2, 4, 5)), np.array([2, 0, 3, 1])
    one = Observation(soft, np.log([0.6, 0.4]), rng.normal(size=(4, 2)), np.array([7, 3, 0, 5]))
    two = replace(
        one,
        soft=soft[:, order],
        descriptors=one.descriptors[order],
        vertices=one.vertices[order] + 10,
    )
    vertex = np.arange(20) - 10
    assert_alike(one, two, vertex, 1e-12)
    assert_alike(one, replace(two, vertices=None), vertex, 1e-12)
    with pytest.raises(AssertionError, match="other vertices"):
        assert_alike(one, replace(two, vertices=two.vertices + 1), vertex, 1e-12)
    changed = soft[:, order].copy()
    changed[1, 2, 3] += 1e-3
    for vertices in (two.vertices, None):
        with pytest.raises(AssertionError, match="Not equal to tolerance"):
            assert_alike(one, replace(two, soft=changed, vertices=vertices), vertex, 1e-4)
