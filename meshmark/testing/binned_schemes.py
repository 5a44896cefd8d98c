"""What every binned scheme must do; subclass `BinnedSchemeSuite` in your own tests to check yours.

class TestMyScheme(BinnedSchemeSuite):
    @pytest.fixture
    def scheme(self):
        return MyScheme(...)
"""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from meshmark.arrays import FloatArray
from meshmark.embedding.mesh import embed_animation
from meshmark.errors import CapacityError
from meshmark.extension.binned_scheme import as_scheme
from meshmark.extension.carrier import Carrier, Chips, measure
from meshmark.extension.hookspecs import BinnedScheme, SchemeRecord
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark.testing.any_scheme import (
    CHANCE,
    KEY,
    NAME,
    OTHER,
    AnySchemeSuite,
    assert_found_blindly,
    needed,
    tetrahedron,
)
from meshmark.testing.invariance import moved, reordered
from meshmark.testing.segmenters import lopsided

# Share of the strength that the suite asks a move for: a nudge, far from any bin's end.
NUDGE = 0.2
# Place in a bin, of which rounding may take a vertex out.
SLACK = 1e-9


def swaying(n_frames: int = 3) -> MeshAnimation:
    """Animate the lopsided dumbbell: it leans over and twists a little, and stays in one piece."""
    V, F = lopsided()
    x, y, z = V.T
    frames = []
    for t in 0.15 * np.arange(n_frames):
        turn = t * z
        points = np.stack(
            [x * np.cos(turn) - y * np.sin(turn) + 0.2 * t * z**2, x * np.sin(turn) + y, z], axis=1
        )
        frames.append(points)
    return MeshAnimation.from_arrays(np.stack(frames), F, prim="/Dumbbell", origin="dumbbell.usda")


class BinnedSchemeSuite(AnySchemeSuite):
    """Checks the contract of one binned scheme; override `scheme`, and what else differs."""

    @pytest.fixture
    def animation(self) -> MeshAnimation:
        """Offer an animation that can be marked, of two frames or more and without symmetry."""
        return swaying()

    @pytest.fixture
    def highest_log10_p(self) -> float:
        """Log10 p that the key's own mark must come below."""
        return CHANCE

    @pytest.fixture
    def frame(self, animation: MeshAnimation) -> Frame:
        """Offer the first frame."""
        return animation[0]

    def test_has_the_interface(self, scheme: BinnedScheme) -> None:
        """Its attributes tell what the core needs to know."""
        assert isinstance(scheme, BinnedScheme)
        assert scheme.n_chips >= 2
        assert scheme.n_words >= 1
        assert scheme.strength > 0
        assert scheme.propagate in ("adapt", "delta")
        assert scheme.rehearsal >= 0

    def test_recorded_parameters_are_the_defaults(
        self, record: SchemeRecord | None, parts: dict[str, Any]
    ) -> None:
        """Giving the recorded defaults changes nothing; `bits` and `strength` are among them."""
        if record is None:
            pytest.skip("no record is offered")
        assert "strength" in record.parameters
        bare = record.factory(**needed(record, parts))
        given = record.factory(**needed(record, parts), **record.parameters)
        for name in ("n_chips", "n_words", "strength", "propagate"):
            assert getattr(given, name) == getattr(bare, name)
        assert given.strength == record.parameters["strength"]

    def test_carriers_are_sound(self, scheme: BinnedScheme, animation: MeshAnimation) -> None:
        """As many for every frame of a layout; vertices, bins and places in range."""
        layout = scheme.layout(animation[0])
        counts, descriptors = set(), set()
        for frame in animation:
            carriers = scheme.carriers(frame, layout)
            counts.add(len(carriers))
            for carrier in carriers:
                assert_sound(carrier, frame, scheme.n_chips)
                descriptors.add(carrier.descriptor.shape)
            assert measure(carriers).held.mean() > 0.5
        assert len(counts) == len(descriptors) == 1
        assert counts.pop() >= 1

    def test_same_frame_same_chips(self, scheme: BinnedScheme, animation: MeshAnimation) -> None:
        """Nothing is drawn by chance, and nothing is kept from one frame to the next."""
        first, last = animation[0], animation[len(animation) - 1]
        layout = scheme.layout(first)
        before = [chips_of(scheme, frame, layout) for frame in (first, last)]
        scheme.layout(last)
        again = scheme.layout(first)
        after = [chips_of(scheme, frame, again) for frame in (last, first)]
        for one, two in zip(before, after[::-1], strict=True):
            np.testing.assert_array_equal(one.value, two.value)
            np.testing.assert_array_equal(one.count, two.count)

    def test_leaves_the_frame_alone(self, scheme: BinnedScheme, frame: Frame) -> None:
        """Measuring and moving never write into the frame they are given."""
        before = frame.points.copy(), frame.faces.copy()
        layout = scheme.layout(frame)
        carriers = scheme.carriers(frame, layout)
        scheme.move(frame, layout, carriers, nudges(scheme, carriers), np.random.default_rng(1))
        np.testing.assert_array_equal(frame.points, before[0])
        np.testing.assert_array_equal(frame.faces, before[1])

    def test_scheme_and_layout_pickle(self, scheme: BinnedScheme, animation: MeshAnimation) -> None:
        """A worker process measures the same chips."""
        layout = scheme.layout(animation[0])
        there, carried = pickle.loads(pickle.dumps((scheme, layout)))
        frame = animation[len(animation) - 1]
        one, two = chips_of(scheme, frame, layout), chips_of(there, frame, carried)
        np.testing.assert_array_equal(one.value, two.value)

    @pytest.mark.parametrize("scale", [1e-3, 1e3])
    def test_similarity_changes_nothing(
        self, scheme: BinnedScheme, frame: Frame, tolerance: float, scale: float
    ) -> None:
        """Turning, scaling and shifting leave every chip, blindly found, as it was."""
        chips = chips_of(scheme, frame, scheme.layout(frame))
        other = frame.moved(moved(frame.points, scale, np.random.default_rng(2)))
        again = chips_of(scheme, other, scheme.layout(other))
        np.testing.assert_allclose(again.value, chips.value, rtol=0, atol=tolerance)
        np.testing.assert_array_equal(again.held, chips.held)

    def test_order_changes_nothing(
        self, scheme: BinnedScheme, frame: Frame, tolerance: float
    ) -> None:
        """Vertices and faces may stand in any order; carriers keep theirs."""
        chips = chips_of(scheme, frame, scheme.layout(frame))
        mixed = reordered(frame.points, frame.faces, np.random.default_rng(3))
        other = Frame(frame.time, mixed.V, Topology.from_triangles(mixed.F, len(mixed.V)))
        again = chips_of(scheme, other, scheme.layout(other))
        np.testing.assert_allclose(again.value, chips.value, rtol=0, atol=tolerance)

    def test_no_shift_no_move(self, scheme: BinnedScheme, frame: Frame) -> None:
        """Where nothing is wanted, nothing moves at all."""
        layout = scheme.layout(frame)
        carriers = scheme.carriers(frame, layout)
        still = [np.zeros(scheme.n_chips) for _ in carriers]
        points = scheme.move(frame, layout, carriers, still, np.random.default_rng(1))
        np.testing.assert_array_equal(points, frame.points)

    def test_moves_change_chips_as_asked(self, scheme: BinnedScheme, frame: Frame) -> None:
        """Chips go where they were asked to, those of which nothing was asked hardly move."""
        layout = scheme.layout(frame)
        carriers = scheme.carriers(frame, layout)
        shifts = np.array(nudges(scheme, carriers))
        points = scheme.move(frame, layout, carriers, list(shifts), np.random.default_rng(1))
        assert points.shape == frame.points.shape
        assert points.dtype == np.float64
        assert np.all(np.isfinite(points))
        after = chips_of(scheme, frame.moved(points), layout)
        change = after.value - measure(carriers).value
        asked = shifts != 0
        # Some bins may have no vertex free to move, but none may go the wrong way for long.
        gain = np.sum(change[asked] * np.sign(shifts[asked]))
        assert gain > 0.5 * np.abs(shifts).sum()
        right = np.sign(change[asked]) == np.sign(shifts[asked])
        assert right.mean() > 0.7
        assert np.abs(change[~asked]).mean() < 0.5 * NUDGE * scheme.strength

    def test_same_generator_same_moves(self, scheme: BinnedScheme, frame: Frame) -> None:
        """All randomness of a move comes from the generator."""
        layout = scheme.layout(frame)
        carriers = scheme.carriers(frame, layout)
        shifts = nudges(scheme, carriers)
        one, two = (
            scheme.move(frame, layout, carriers, shifts, np.random.default_rng(7)) for _ in range(2)
        )
        np.testing.assert_array_equal(one, two)

    def test_a_mark_is_found_blindly_by_its_key_alone(
        self, scheme: BinnedScheme, animation: MeshAnimation, highest_log10_p: float
    ) -> None:
        """Through float32, without the original: the key fits, no other does, nor the original."""
        embedded = assert_found_blindly(as_scheme(scheme), animation, highest_log10_p)
        assert embedded.carriers >= 1

    def test_marks_are_the_keys(self, scheme: BinnedScheme, animation: MeshAnimation) -> None:
        """Equal keys give equal bytes, another key another mark."""
        one, two, other = (
            embed_animation(animation.select([0]), as_scheme(scheme), NAME, key).animation[0].points
            for key in (KEY, KEY, OTHER)
        )
        np.testing.assert_array_equal(one, two)
        assert np.any(one != other)

    def test_what_is_too_small_is_refused(self, scheme: BinnedScheme) -> None:
        """A tetrahedron has no room for a mark, and `layout` says so."""
        V, F = tetrahedron()
        with pytest.raises(CapacityError):
            scheme.layout(Frame(1.0, V, Topology.from_triangles(F, 4)))


def assert_sound(carrier: Carrier, frame: Frame, n_chips: int) -> None:
    """Fail unless a carrier's arrays are consistent and in range."""
    n = len(carrier.vertices)
    assert carrier.n_bins == n_chips
    assert carrier.bins.shape == carrier.bin_fraction.shape == (n,)
    assert carrier.vertices.dtype.kind in "iu"
    assert carrier.bins.dtype.kind in "iu"
    assert len(np.unique(carrier.vertices)) == n
    assert carrier.vertices.min() >= 0
    assert carrier.vertices.max() < len(frame.points)
    assert carrier.bins.min() >= -1
    assert carrier.bins.max() < n_chips
    place = carrier.bin_fraction[carrier.bins >= 0]
    assert place.size
    assert place.min() >= -SLACK
    assert place.max() <= 1.0 + SLACK
    assert carrier.descriptor.ndim == 1
    assert np.all(np.isfinite(carrier.descriptor))


def chips_of(scheme: BinnedScheme, frame: Frame, layout: Any) -> Chips:
    """Measure the chips of one frame."""
    return measure(scheme.carriers(frame, layout))


def nudges(scheme: BinnedScheme, carriers: Sequence[Carrier]) -> list[FloatArray]:
    """Ask for a small shift, up or down, of about a third of the chips that are held."""
    held = measure(carriers).held
    rng = np.random.default_rng(5)
    wanted = rng.choice([-1.0, 0.0, 0.0, 1.0], size=held.shape)
    return list(NUDGE * scheme.strength * np.where(held, wanted, 0.0))
