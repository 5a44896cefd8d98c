"""What every informed scheme must do; subclass `InformedSchemeSuite` in your tests to check yours.

class TestMyScheme(InformedSchemeSuite):
    @pytest.fixture
    def scheme(self):
        return MyScheme(...)
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from meshmark.detection.evidence import Evidence
from meshmark.detection.informed import extract_informed
from meshmark.detection.original_layout import OriginalLayout
from meshmark.detection.significance import judge, log10_p_of
from meshmark.embedding.mesh import embed_animation, plan_informed
from meshmark.errors import CapacityError
from meshmark.extension.carrier import Observation
from meshmark.extension.hookspecs import SchemeRecord
from meshmark.extension.informed import (
    MOST_VERTICES,
    AlignedFrame,
    InformedScheme,
    VertexReader,
    signs_of,
)
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import surface_box, vertex_normals
from meshmark.mesh.topology import Topology
from meshmark.metrics.faces import flipped_faces
from meshmark.testing.any_scheme import (
    CHANCE,
    KEY,
    NAME,
    OTHER,
    PlanningSchemeSuite,
    assert_moved,
    needed,
    rounded,
    tetrahedron,
)
from meshmark.testing.meshes import bumpy_sphere
from meshmark.testing.schemes import analysed, assert_equal, assert_sound

WHOSE = "somebody"
# Random words and keys tried on what bears no mark of theirs, and how often they may fit.
WORDS, KEYS = 2000, 25
RATES = (0.1, 0.01)
# Noise of a copy, as a share of the diagonal.
NOISE = 1e-4
HORNS = np.array([[1.0, 0.2, 0.1], [-0.3, 1.0, 0.4], [0.2, -0.8, 1.0], [-0.7, -0.3, -0.9]])


@lru_cache(maxsize=1)
def horned() -> MeshAnimation:
    """Animate a ball with four horns, of which one grows and another shrinks: three frames."""
    _, F = bumpy_sphere(3, HORNS)
    heights = (np.array([1.0 + t, 0.5, 1.5 - t, 0.8]) for t in (0.0, 0.25, 0.5))
    frames = np.stack([bumpy_sphere(3, HORNS, height, 0.35)[0] for height in heights])
    return MeshAnimation.from_arrays(frames, F, prim="/Horns", origin="horns.usda")


class InformedSchemeSuite(PlanningSchemeSuite):
    """Checks the contract of one informed scheme; override `scheme`, and what else differs."""

    @pytest.fixture
    def animation(self) -> MeshAnimation:
        """Offer an animation that can be marked, of two frames or more and without symmetry."""
        return horned()

    @pytest.fixture
    def frame(self, animation: MeshAnimation) -> Frame:
        """Offer the first frame, as analysis sees it."""
        return analysed(animation)[0]

    def test_has_the_interface(self, scheme: InformedScheme, frame: Frame) -> None:
        """Its methods are there, and its layout tells what the core needs to know."""
        assert isinstance(scheme, InformedScheme)
        layout = scheme.layout(frame)
        assert layout.n_chips >= 2
        assert layout.owner.shape == (layout.n_chips,)
        assert layout.owner.dtype == np.bool_

    def test_recorded_parameters_are_the_defaults(
        self, record: SchemeRecord | None, parts: dict[str, Any], frame: Frame
    ) -> None:
        """Giving the recorded defaults changes nothing."""
        if record is None:
            pytest.skip("no record is offered")
        assert record.informed
        bare = record.factory(**needed(record, parts))
        given = record.factory(**needed(record, parts), **record.parameters)
        view = copied(frame)
        assert_equal(observed(given, frame, view), observed(bare, frame, view))

    def test_the_same_frame_has_the_same_layout(
        self, scheme: InformedScheme, animation: MeshAnimation
    ) -> None:
        """Nothing is drawn by chance, and nothing is kept from one frame to the next."""
        first, last = analysed(animation)[0], analysed(animation)[len(animation) - 1]
        one = scheme.layout(first)
        scheme.layout(last)
        two = pickle.loads(pickle.dumps(scheme)).layout(first)
        assert one.n_chips == two.n_chips
        np.testing.assert_array_equal(one.owner, two.owner)
        signs = signs_of(KEY, NAME, one, None)
        marked = [
            scheme.plan(analysed(animation), layout, signs, jobs=1).mark(0, first)
            for layout in (one, two)
        ]
        np.testing.assert_array_equal(marked[0], marked[1])

    def test_the_owner_has_the_same_chips_in_every_copy(
        self, scheme: InformedScheme, frame: Frame
    ) -> None:
        """Copies differ in a recipient's chips alone, and hold some of each."""
        layout = scheme.layout(frame)
        own, one, two = (signs_of(KEY, NAME, layout, name) for name in (None, WHOSE, "another"))
        np.testing.assert_array_equal(one[layout.owner], own[layout.owner])
        np.testing.assert_array_equal(two[layout.owner], own[layout.owner])
        assert layout.owner.any()
        assert np.any(one[~layout.owner] != two[~layout.owner])

    def test_a_plan_is_all_a_worker_needs(
        self, scheme: InformedScheme, animation: MeshAnimation
    ) -> None:
        """It pickles, marks frames in any order, turns no face over, and writes into no frame."""
        pair = animation.select([0, len(animation) - 1])
        before = [frame.points.copy() for frame in pair]
        plan = plan_informed(
            pair,
            OriginalLayout(animation, scheme),
            lambda layout: signs_of(KEY, NAME, layout, None),
            jobs=1,
        )
        there = pickle.loads(pickle.dumps(plan))
        moves = [plan(t) for t in (1, 0)][::-1]
        for t, frame in enumerate(pair):
            np.testing.assert_array_equal(there(t), moves[t])
            np.testing.assert_array_equal(frame.points, before[t])
            marked = rounded(frame.moved(frame.points + moves[t]))
            assert flipped_faces(frame.points, marked.points, frame.faces) == 0

    def test_sightings_are_sound(self, scheme: InformedScheme, frame: Frame) -> None:
        """Evidence and beliefs are in range, whether a copy lies far away or exactly there."""
        layout, view = scheme.layout(frame), copied(frame)
        diagonal, _ = surface_box(frame.points, frame.faces)
        far = replace(view, points=view.points + 10.0 * diagonal)
        few = replace(view, points=view.points[:1], normals=view.normals[:1])
        exact = replace(view, points=frame.points)
        for each in (view, exact, far, few):
            seen = observed(scheme, frame, each)
            assert_sound(seen, frame, layout.n_chips)
            assert seen.soft.shape[1] == 1
        assert np.any(observed(scheme, frame, view).soft)

    def test_same_view_same_sighting(self, scheme: InformedScheme, frame: Frame) -> None:
        """Neither other views nor another process change what is seen, nor is a view written to."""
        layout, view = scheme.layout(frame), copied(frame)
        before = view.points.copy(), view.reference.points.copy()
        treatment = scheme.treatment([view])
        measured = scheme.measure(view, treatment)
        (seen,) = scheme.observe([measured], layout)
        other = replace(view, points=view.reference.points, normals=view.normals)
        observed(scheme, frame, other)
        there, how, what = pickle.loads(pickle.dumps((scheme, treatment, measured)))
        assert_equal(there.observe([there.measure(view, how)], layout)[0], seen)
        assert_equal(there.observe([what], layout)[0], seen)
        np.testing.assert_array_equal(view.points, before[0])
        np.testing.assert_array_equal(view.reference.points, before[1])

    def test_order_changes_nothing(
        self, scheme: InformedScheme, frame: Frame, tolerance: float
    ) -> None:
        """The copy's vertices may stand in any order."""
        view = copied(frame)
        order = np.random.default_rng(3).permutation(len(view.points))
        mixed = replace(view, points=view.points[order], normals=view.normals[order])
        one, two = (observed(scheme, frame, each) for each in (view, mixed))
        np.testing.assert_allclose(two.soft, one.soft, rtol=0, atol=tolerance)
        np.testing.assert_allclose(two.log_prior, one.log_prior, rtol=0, atol=tolerance)

    def test_a_mark_is_found_beside_the_original_by_its_key_alone(
        self, scheme: InformedScheme, animation: MeshAnimation, highest_log10_p: float
    ) -> None:
        """Through float32: the key fits, no other does, nor the original."""
        evidence = leaked(scheme, animation, None)
        assert judge(evidence, KEY).log10_p < highest_log10_p
        assert judge(evidence, OTHER).log10_p > CHANCE
        assert judge(evidence, KEY, WHOSE).log10_p > CHANCE
        unmarked = extract_informed(animation.map(rounded), animation, scheme, NAME)
        assert judge(unmarked, KEY).log10_p > CHANCE

    def test_a_recipient_is_named(
        self, scheme: InformedScheme, animation: MeshAnimation, highest_log10_p: float
    ) -> None:
        """The copy tells whose it is, beside whom it comes from, and names nobody else."""
        evidence = leaked(scheme, animation, WHOSE)
        assert judge(evidence, KEY, WHOSE).log10_p < highest_log10_p
        assert judge(evidence, KEY).log10_p < CHANCE
        assert judge(evidence, KEY, "another").log10_p > CHANCE
        assert judge(evidence, OTHER, WHOSE).log10_p > CHANCE

    @pytest.mark.parametrize("marked", [False, True], ids=["unmarked", "marked"])
    def test_random_words_fit_no_more_often_than_by_chance(
        self, scheme: InformedScheme, animation: MeshAnimation, marked: bool
    ) -> None:
        """Whatever the copy, p is at most a for at most a share a of random keys."""
        rng = np.random.default_rng(4)
        if marked:
            evidence = leaked(scheme, animation, None)
        else:
            copy = animation.map(lambda frame: frame.moved(noisy(frame, rng)))
            evidence = extract_informed(copy, animation, scheme, NAME)
        words = rng.choice(np.array([-1, 1]), (WORDS, 1, evidence.n_chips))
        assert_rare(log10_p_of(evidence, words), RATES)

    def test_vertices_of_a_copy_tell_of_random_names_no_more_often_than_by_chance(
        self, scheme: InformedScheme, animation: MeshAnimation
    ) -> None:
        """E-values of single vertices are e-values, over keys: if the scheme offers any."""
        evidence = leaked(scheme, animation, WHOSE)
        if not isinstance(scheme, VertexReader) or evidence.vertices is None:
            pytest.skip("the scheme reads no single vertices")
        assert evidence.vertices.steps.dtype == np.int16
        assert len(evidence.vertices.steps) <= MOST_VERTICES
        keys = [Key(bytes([n] * 32)) for n in range(KEYS)]
        log_e = [evidence.vertices.log_e(key, NAME, [WHOSE, "another"]) for key in keys]
        assert_rare(-np.concatenate(log_e) / np.log(10.0), RATES)
        assert evidence.vertices.log_e(KEY, NAME, [WHOSE])[0] > np.log(10.0)

    def test_the_mean_over_frames_tells_more_than_one(
        self, scheme: InformedScheme, animation: MeshAnimation
    ) -> None:
        """Each frame has evidence of its own, under the same hypotheses."""
        evidence = leaked(scheme, animation, None)
        (variant,) = evidence.variants
        assert len(variant.frames) == len(animation)
        together = judge(evidence, KEY).log10_p
        assert together <= np.median(judge(evidence, KEY).log10_p_per_frame) + 1.0

    def test_what_is_too_small_is_refused(self, scheme: InformedScheme) -> None:
        """A tetrahedron has no room for a mark, and `layout` says so."""
        V, F = tetrahedron()
        with pytest.raises(CapacityError):
            scheme.layout(Frame(1.0, V, Topology.from_triangles(F, 4)))


def leaked(scheme: InformedScheme, animation: MeshAnimation, recipient: str | None) -> Evidence:
    """Mark an animation, pass it through float32, and measure it against the original."""
    embedded = embed_animation(animation, scheme, NAME, KEY, recipient=recipient)
    copy = embedded.animation.map(rounded)
    assert_moved(animation, copy)
    assert embedded.carriers >= 1
    return extract_informed(copy, animation, scheme, NAME)


def copied(frame: Frame) -> AlignedFrame:
    """Lay a copy of a frame with a little noise upon it."""
    points = noisy(frame, np.random.default_rng(1))
    normals = vertex_normals(points, frame.faces)
    return AlignedFrame(frame, np.zeros_like(points), points, normals)


def noisy(frame: Frame, rng: np.random.Generator) -> Any:
    """Add noise to the points of a frame, (N, 3) float64."""
    diagonal, _ = surface_box(frame.points, frame.faces)
    return frame.points + rng.normal(0.0, NOISE * diagonal, frame.points.shape)


def observed(scheme: InformedScheme, original: Frame, view: AlignedFrame) -> Observation:
    """Observe one view of a copy."""
    layout = scheme.layout(original)
    measured = scheme.measure(view, scheme.treatment([view]))
    return scheme.observe([measured], layout)[0]


def assert_rare(log10_p: Any, rates: Sequence[float]) -> None:
    """Fail if more of random keys have p <= a than a, by more than chance explains."""
    for rate in rates:
        share = float((log10_p <= np.log10(rate)).mean())
        assert share <= rate + 3.0 * np.sqrt(rate / len(log10_p))
