"""What every scheme must do; subclass `SchemeSuite` in your own tests to check yours.

class TestMyScheme(SchemeSuite):
    @pytest.fixture
    def scheme(self):
        return MyScheme(...)
"""

from __future__ import annotations

import pickle
from contextlib import suppress
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.special import logsumexp

from meshmark.arrays import IntArray
from meshmark.embedding.mesh import plan_marking
from meshmark.errors import CapacityError
from meshmark.extension.carrier import Observation
from meshmark.extension.hookspecs import SchemeRecord
from meshmark.extension.interfaces import Scheme
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.mesh.welding import Welding
from meshmark.metrics.faces import flipped_faces
from meshmark.testing.any_scheme import (
    KEY,
    NAME,
    PlanningSchemeSuite,
    assert_found_blindly,
    needed,
    rounded,
    tetrahedron,
)
from meshmark.testing.invariance import moved, reordered
from meshmark.testing.meshes import Mesh, plane

# Beliefs may exceed 1 in sum by what rounding adds.
SLACK = 1e-9
# What coordinates are rounded to where the suite stores them.
STEP = 1e-7


@lru_cache(maxsize=1)
def galloping() -> MeshAnimation:
    """Animate a small creature, whose tips stick out: a stride in four frames."""
    from meshmark.demo import creature

    return creature(points=3000, frames=4)


def needle() -> Mesh:
    """Build two triangles without area: their corners stand in one line."""
    return np.outer([0.0, 1.0, 2.0, 4.0], [1.0, 2.0, 3.0]), np.array([[0, 1, 2], [0, 2, 3]])


class SchemeSuite(PlanningSchemeSuite):
    """Checks the contract of one scheme; override `scheme`, and what else differs."""

    @pytest.fixture
    def animation(self) -> MeshAnimation:
        """Offer an animation that can be marked, of four frames or more."""
        return galloping()

    @pytest.fixture
    def frame(self, animation: MeshAnimation) -> Frame:
        """Offer the first frame, as analysis sees it."""
        return analysed(animation)[0]

    def test_has_the_interface(self, scheme: Scheme) -> None:
        """Its attributes tell what the core needs to know."""
        assert isinstance(scheme, Scheme)
        assert scheme.n_chips >= 2
        assert scheme.n_words >= 1
        assert isinstance(scheme.restorations, tuple)
        assert scheme.restorations[0] == 0
        assert list(scheme.restorations) == sorted(set(scheme.restorations))
        assert isinstance(scheme.follows_vertices, bool)

    def test_recorded_parameters_are_the_defaults(
        self, record: SchemeRecord | None, parts: dict[str, Any], frame: Frame
    ) -> None:
        """Giving the recorded defaults changes nothing."""
        if record is None:
            pytest.skip("no record is offered")
        bare = record.factory(**needed(record, parts))
        given = record.factory(**needed(record, parts), **record.parameters)
        for name in ("n_chips", "n_words", "restorations"):
            assert getattr(given, name) == getattr(bare, name)
        np.testing.assert_array_equal(given.observe(frame).soft, bare.observe(frame).soft)

    def test_sightings_are_sound(self, scheme: Scheme, animation: MeshAnimation) -> None:
        """Evidence and beliefs in range; hypotheses are the same ones in every frame."""
        observations = [scheme.observe(frame) for frame in analysed(animation)]
        for observation, frame in zip(observations, analysed(animation), strict=True):
            assert_sound(observation, frame, scheme.n_chips)
            assert np.any(observation.soft)
            assert observation.log_prior.shape == observations[0].log_prior.shape
            assert observation.descriptors.shape[1] == observations[0].descriptors.shape[1]
            assert (observation.vertices is None) == (observations[0].vertices is None)
            assert (observation.posterior is None) == (observations[0].posterior is None)

    def test_same_frame_same_sighting(self, scheme: Scheme, animation: MeshAnimation) -> None:
        """Nothing is drawn by chance, and nothing is kept from one frame to the next."""
        whole = analysed(animation)
        first, last = whole[0], whole[len(whole) - 1]
        before = [scheme.observe(frame) for frame in (first, last)]
        after = [scheme.observe(frame) for frame in (last, first)]
        for one, two in zip(before, after[::-1], strict=True):
            assert_equal(one, two)

    def test_a_worker_sees_the_same(self, scheme: Scheme, frame: Frame) -> None:
        """The scheme pickles, and looks alike wherever it is unpickled."""
        assert_equal(pickle.loads(pickle.dumps(scheme)).observe(frame), scheme.observe(frame))

    @pytest.mark.parametrize("scale", [1e-3, 1e3])
    def test_similarity_changes_nothing(
        self, scheme: Scheme, frame: Frame, tolerance: float, scale: float
    ) -> None:
        """Turning, scaling and shifting leave all evidence as it was."""
        other = frame.moved(moved(frame.points, scale, np.random.default_rng(2)))
        same = np.arange(len(frame.points))
        assert_alike(scheme.observe(frame), scheme.observe(other), same, tolerance)

    def test_order_changes_nothing(self, scheme: Scheme, frame: Frame, tolerance: float) -> None:
        """Vertices and faces may stand in any order."""
        mixed = reordered(frame.points, frame.faces, np.random.default_rng(3))
        other = Frame(frame.time, mixed.V, Topology.from_triangles(mixed.F, len(mixed.V)))
        assert_alike(scheme.observe(frame), scheme.observe(other), mixed.vertex, tolerance)

    def test_a_mark_is_found_blindly_by_its_key_alone(
        self, scheme: Scheme, animation: MeshAnimation, highest_log10_p: float
    ) -> None:
        """Through float32, without the original: the key fits, no other does, nor the original."""
        embedded = assert_found_blindly(scheme, animation, highest_log10_p)
        assert 1 <= embedded.carriers <= scheme.n_words

    def test_a_plan_is_all_a_worker_needs(self, scheme: Scheme, animation: MeshAnimation) -> None:
        """It pickles, marks frames in any order, turns no face over, and writes into no frame."""
        pair = animation.select([0, len(animation) - 1])
        before = [frame.points.copy() for frame in pair]
        words = KEY.words(NAME, scheme.n_words, scheme.n_chips)
        drawn = KEY.generator(NAME)
        plan = plan_marking(pair, scheme, words, generator=drawn, step=STEP, jobs=1)
        there = pickle.loads(pickle.dumps(plan))
        moves = [plan(t) for t in (1, 0)][::-1]
        for t, frame in enumerate(pair):
            np.testing.assert_array_equal(there(t), moves[t])
            np.testing.assert_array_equal(frame.points, before[t])
            marked = rounded(frame.moved(frame.points + moves[t]))
            assert flipped_faces(frame.points, marked.points, frame.faces) == 0

    def test_what_can_be_marked_is_not_refused(
        self, scheme: Scheme, animation: MeshAnimation
    ) -> None:
        """`require_capacity` passes what `plan` would mark."""
        scheme.require_capacity(analysed(animation), jobs=1)

    def test_what_is_too_small_is_refused(self, scheme: Scheme) -> None:
        """A tetrahedron has no room for a mark, and both who could say so do."""
        V, F = tetrahedron()
        small = MeshAnimation.from_arrays(V[None], F)
        words = KEY.words(NAME, scheme.n_words, scheme.n_chips)
        with pytest.raises(CapacityError):
            scheme.require_capacity(small, jobs=1)
        with pytest.raises(CapacityError):
            scheme.plan(small, words, generator=KEY.generator(NAME), step=STEP, jobs=1)

    @pytest.mark.parametrize("mesh", [tetrahedron(), plane(2), plane(12), needle()])
    def test_sees_something_sound_or_refuses(self, scheme: Scheme, mesh: Mesh) -> None:
        """Leaked copies come in every state; what holds no carrier is a `CapacityError`."""
        V, F = mesh
        frame = Frame(1.0, V, Topology.from_triangles(F, len(V)))
        with suppress(CapacityError):
            assert_sound(scheme.observe(frame), frame, scheme.n_chips)


def analysed(animation: MeshAnimation) -> MeshAnimation:
    """Return an animation of one topology as analysis sees it."""
    return animation.map(Welding.of(animation[0]).frame)


def assert_sound(observation: Observation, frame: Frame, n_chips: int) -> None:
    """Fail unless a observation's arrays are consistent and in range."""
    R, C, K = observation.soft.shape
    assert min(R, C) >= 1
    assert n_chips == K
    assert np.all(np.isfinite(observation.soft))
    assert np.abs(observation.soft).max() <= 1.0
    assert observation.log_prior.shape == (R,)
    assert float(logsumexp(observation.log_prior)) <= SLACK
    assert observation.descriptors.ndim == 2
    assert len(observation.descriptors) == C
    assert np.all(np.isfinite(observation.descriptors))
    if observation.posterior is not None:
        assert observation.posterior.position.shape == (R, C)
        assert observation.posterior.p_null.shape == (C,)
        assert np.all((observation.posterior.p_null > 0.0) & (observation.posterior.p_null < 1.0))
    if observation.vertices is not None:
        assert observation.vertices.shape == (C,)
        assert observation.vertices.dtype.kind in "iu"
        assert len(np.unique(observation.vertices)) == C
        assert observation.vertices.min() >= 0
        assert observation.vertices.max() < len(frame.points)


def assert_equal(one: Observation, two: Observation) -> None:
    """Fail unless two observations are the same to the last bit."""
    np.testing.assert_array_equal(one.soft, two.soft)
    np.testing.assert_array_equal(one.log_prior, two.log_prior)
    np.testing.assert_array_equal(one.descriptors, two.descriptors)
    np.testing.assert_array_equal(one.vertices, two.vertices)
    if one.posterior is not None and two.posterior is not None:
        np.testing.assert_array_equal(one.posterior.position, two.posterior.position)
        np.testing.assert_array_equal(one.posterior.p_null, two.posterior.p_null)


def assert_alike(one: Observation, two: Observation, vertex: IntArray, tolerance: float) -> None:
    """Fail unless two observations of one shape agree, in whatever order their carriers stand.

    Parameters
    ----------
    vertex : (N,) int
        For each vertex of the second frame, the same vertex of the first.
    """
    assert one.soft.shape == two.soft.shape
    np.testing.assert_allclose(one.log_prior, two.log_prior, rtol=0, atol=tolerance)
    gap = np.abs(two.soft[:, None] - one.soft[:, :, None]).max(axis=(0, 3))
    if one.vertices is not None and two.vertices is not None:
        gap = (one.vertices[:, None] != vertex[two.vertices]).astype(np.float64)
        assert np.all(gap.min(axis=0) == 0.0), "carriers stand at other vertices"
    _, order = linear_sum_assignment(gap)
    np.testing.assert_allclose(two.soft[:, order], one.soft, rtol=0, atol=tolerance)
    np.testing.assert_allclose(
        two.descriptors[order], one.descriptors, rtol=tolerance, atol=tolerance
    )
    if one.posterior is not None and two.posterior is not None:
        places = two.posterior.position[:, order]
        np.testing.assert_allclose(places, one.posterior.position, rtol=0, atol=20.0 * tolerance)
