from __future__ import annotations

import numpy as np
import pytest

from meshmark.detection.extraction import extract
from meshmark.detection.significance import judge
from meshmark.embedding.mesh import embed_animation
from meshmark.errors import CapacityError, InputError
from meshmark.extension.binned_scheme import as_scheme
from meshmark.extension.carrier import measure
from meshmark.extension.closed_loop import drive, settle
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.topology import Topology
from meshmark_plugins.schemes.tsai2014.moves import extreme_neighbours, share_out, steepness
from meshmark_plugins.schemes.tsai2014.parts import labelled_parts, smallest_loop

KEY = Key(bytes(range(32)))


def tube(n_round: int = 24, n_along: int = 120, length: float = 10.0):
    """Return an open tube of radius 1 along z, and its faces."""
    angle = 2 * np.pi * np.arange(n_round) / n_round
    z = np.linspace(0, length, n_along)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(n_round)], axis=1)
    V = (ring[None] + z[:, None, None] * [0, 0, 1]).reshape(-1, 3)
    a = (np.arange(n_along - 1)[:, None] * n_round + np.arange(n_round)).ravel()
    b = (np.arange(n_along - 1)[:, None] * n_round + (np.arange(n_round) + 1) % n_round).ravel()
    F = np.concatenate(
        [np.stack([a, b, a + n_round], 1), np.stack([b, b + n_round, a + n_round], 1)]
    )
    return V, F


class HalfCut:
    """Cuts along z at 40 % of the length."""

    def segment(self, V, F):
        z = V[F].mean(axis=1)[:, 2]
        return (z > z.min() + 0.4 * np.ptp(z)).astype(np.int64)


class AlongAxis:
    """Distance along z alone: exact between rings of a tube."""

    def __init__(self, V, F):
        self.V = V

    def distances(self, sources):
        return np.abs(self.V[sources][:, None, 2] - self.V[:, 2])


def scheme(**parameters):
    from meshmark_plugins.schemes.tsai2014.scheme import Tsai2014

    return Tsai2014(**{"segmenter": HalfCut(), "solver": AlongAxis, **parameters})


@pytest.fixture
def tube_frame() -> Frame:
    V, F = tube()
    rng = np.random.default_rng(4)
    # Uneven rings, so that no chip is balanced by symmetry.
    V[:, 2] += 0.02 * rng.normal(size=len(V))
    return Frame(1.0, V, Topology.from_triangles(F, len(V)))


def test_the_smallest_loop_is_taken() -> None:
    cut = np.array([[0, 1], [1, 2], [2, 0], [5, 6], [6, 7], [7, 8], [8, 5]])
    assert smallest_loop(cut).tolist() == [0, 1, 2]


def test_parts_of_a_tube() -> None:
    _, F = tube()
    row = np.tile(np.arange(119).repeat(24), 2)
    parts = labelled_parts(F, (row >= 40).astype(np.int64) + (row >= 80), 64)
    assert len(parts) == 3
    assert [len(part.loop) for part in parts] == [24, 24, 24]
    # The middle part has two cuts of equal size; the two rings beside a cut are fixed too.
    assert [np.sum(~part.inside) for part in parts] == [24, 48, 24]
    assert [part.fixed.sum() for part in parts] == [72, 144, 72]
    assert sum(len(part.faces) for part in parts) == len(F)


def test_uncut_components_and_small_parts_are_left_out() -> None:
    V, F = tube()
    assert labelled_parts(F, np.zeros(len(F), dtype=np.int64), 64) == ()
    labels = (V[F].mean(axis=1)[:, 2] > 9.9).astype(np.int64)
    assert len(labelled_parts(F, labels, 64)) == 1


def test_sets_are_upper_closed_and_the_farthest_vertex_is_in_the_last(tube_frame) -> None:
    made = scheme()
    layout = made.layout(tube_frame)
    for carrier in made.carriers(tube_frame, layout):
        inside = carrier.bins >= 0
        assert carrier.distance[inside].max() == pytest.approx(16.0)
        assert carrier.bins[inside].max() == 15
        assert np.all(carrier.bin_fraction[inside] > 0)
        assert np.all(carrier.bin_fraction[inside] <= 1)
        np.testing.assert_allclose(
            (carrier.bins + carrier.bin_fraction)[inside], carrier.distance[inside]
        )


def test_chips_are_zero_at_the_centre_of_a_set() -> None:
    # Distances 1, 2, ... 160 of 160: ten a set, their mean half a step above the centre.
    from meshmark.extension.carrier import Carrier

    x = np.arange(1, 161) / 10
    bins = np.ceil(x).astype(int) - 1
    chips = measure([Carrier(np.arange(160), bins, x - bins, 16, np.zeros(1))])
    np.testing.assert_allclose(chips.value, 0.05)
    assert np.all(chips.count == 10)


def test_the_set_in_which_distances_begin_is_an_erasure_unless_it_is_filled() -> None:
    from meshmark_plugins.schemes.tsai2014.scheme import _truncated_set

    assert _truncated_set(np.array([2.5, 2.9, 3.5, 15.0])) == 2
    assert _truncated_set(np.array([2.1, 2.9, 3.5, 15.0])) == -1
    # A distance of exactly 3 is the upper end of set 2, and alone there.
    assert _truncated_set(np.array([3.0, 3.1])) == 2


def test_neighbours_uphill_and_downhill() -> None:
    d = np.array([0.0, 1.0, 3.0, 2.0])
    E = np.array([[0, 1], [1, 2], [1, 3], [2, 3]])
    up = extreme_neighbours(d, E, np.ones(4, dtype=bool))
    assert up.neighbour.tolist() == [1, 2, 2, 2]
    assert up.gain.tolist() == [1, 2, 0, 1]
    down = extreme_neighbours(d, E, np.zeros(4, dtype=bool))
    assert down.neighbour.tolist() == [0, 0, 1, 1]
    assert down.gain.tolist() == [0, 1, 2, 1]


def test_changes_are_taken_in_turn_until_there_is_enough() -> None:
    bins = np.array([1, 0, 1, 1, -1])
    turn = np.array([2.0, 0.0, 0.0, 1.0, 0.0])
    needed, available = np.array([0.1, 1.0]), np.array([0.6, 0.5, 0.6, 0.3, 9.0])
    taken = share_out(needed, bins, available, turn, 1)
    np.testing.assert_allclose(taken, [0.1, 0.1, 0.6, 0.3, 0.0])
    # In three picks all of a set take part, and those whose turn comes first once more.
    taken = share_out(np.array([0.1, 0.8]), bins, available, turn, 3)
    np.testing.assert_allclose(taken, [0.2, 0.1, 0.4, 0.2, 0.0])
    assert not share_out(needed, np.full(5, -1), available, turn, 3).any()


def test_steepness_is_the_sine_out_of_the_surface() -> None:
    V = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 5], [3, 3, 3]])
    F = np.array([[0, 1, 2]])
    towards = np.array([3, 2, 4, 3, 4])
    expected = [1.0, 0.0, 3 / np.sqrt(22), 0.0, 0.0]
    np.testing.assert_allclose(steepness(V, F, towards), expected, atol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_move_shifts_the_mean_by_what_is_asked(tube_frame, sign) -> None:
    made = scheme()
    layout = made.layout(tube_frame)
    carriers = made.carriers(tube_frame, layout)
    shift = np.zeros(16)
    shift[7] = sign * 0.04
    before = measure(carriers).value
    shifts = [shift, np.zeros(16)]
    points = made.move(tube_frame, layout, carriers, shifts, np.random.default_rng(0))
    after = measure(made.carriers(tube_frame.moved(points), layout)).value
    assert after[0, 7] - before[0, 7] == pytest.approx(sign * 0.04, abs=1e-9)
    others = np.delete(np.arange(16), 7)
    np.testing.assert_allclose(after[0, others], before[0, others], atol=1e-12)
    np.testing.assert_array_equal(after[1], before[1])


def test_the_closed_loop_reaches_every_target_and_spares_cut_and_farthest(tube_frame) -> None:
    made = scheme()
    words = KEY.words("tsai2014", 8, 16)
    plan = settle(tube_frame, made, words, KEY.generator("test"), 1e-7)
    points = drive(tube_frame, plan)
    chips = measure(made.carriers(tube_frame.moved(points), plan.layout))
    assert chips.held.all()
    # The rings beside the cut are held still: the set next to it may have nobody to move.
    reached = plan.words * chips.value >= made.strength
    assert reached[:, 1:].all()
    before = made.carriers(tube_frame, plan.layout)
    after = made.carriers(tube_frame.moved(points), plan.layout)
    V = tube_frame.points
    for part, old, new in zip(plan.layout, before, after, strict=True):
        fixed = part.vertices[part.fixed]
        np.testing.assert_array_equal(points[fixed], V[fixed])
        farthest = part.vertices[np.argmax(np.where(old.bins >= 0, old.distance, 0))]
        np.testing.assert_array_equal(points[farthest], V[farthest])
        # In units of d_max: unchanged distances of unmoved vertices mean an unchanged d_max.
        still = np.all(points[part.vertices] == V[part.vertices], axis=1)
        np.testing.assert_allclose(new.distance[still], old.distance[still], atol=1e-12)


def swinging(frame: Frame, n: int) -> MeshAnimation:
    """Stretch and turn a frame over time."""
    frames = []
    for t in range(n):
        a, s = 0.2 * t, 1 + 0.1 * np.sin(t)
        R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, s]])
        frames.append(Frame(float(t), frame.points @ R.T, frame.topology))
    return MeshAnimation.from_frames(frames)


@pytest.mark.parametrize("propagate", ["adapt", "delta"])
def test_marked_frames_are_found_blindly(tube_frame, propagate) -> None:
    made = scheme(propagate=propagate)
    animation = swinging(tube_frame, 5)
    marked = embed_animation(animation, as_scheme(made), "tsai2014", KEY).animation
    found = judge(extract(marked, as_scheme(made), "tsai2014"), KEY)
    assert found.log10_p < -5
    # A stretched tube keeps shares of d_max, so that carried changes hold in every frame.
    assert found.errors.maximum == 0.0
    assert judge(extract(animation, as_scheme(made), "tsai2014"), KEY).log10_p > -2


def test_equal_runs_are_byte_equal_and_other_keys_differ(tube_frame) -> None:
    animation = swinging(tube_frame, 2)
    runs = [
        embed_animation(animation, as_scheme(scheme()), "tsai2014", key)
        .animation[1]
        .points.tobytes()
        for key in (KEY, KEY, Key(bytes(32)))
    ]
    assert runs[0] == runs[1] != runs[2]


def test_frames_outside_the_range_stay_as_they_are(tube_frame) -> None:
    animation = swinging(tube_frame, 4)
    marked = embed_animation(
        animation, as_scheme(scheme()), "tsai2014", KEY, frames=(1, 2)
    ).animation
    moved = [np.any(marked[i].points != animation[i].points) for i in range(4)]
    assert moved == [False, True, True, False]


def test_what_cannot_hold_a_mark_is_refused_with_the_reason(tube_frame) -> None:
    class Uncut:
        def segment(self, V, F):
            return np.zeros(len(F), dtype=np.int64)

    with pytest.raises(CapacityError, match="no part can hold 16 bits: 2880 points in 1 part;"):
        scheme(segmenter=Uncut()).layout(tube_frame)


def test_changing_connectivity_cannot_be_marked(tube_frame) -> None:
    V, F = tube(n_along=60)
    other = Frame(2.0, V, Topology.from_triangles(F, len(V)))
    animation = MeshAnimation.from_frames([tube_frame, other], prim="/Tube", origin="t.usd")
    with pytest.raises(InputError, match=r"t\.usd: /Tube: the connectivity changes"):
        embed_animation(animation, as_scheme(scheme()), "tsai2014", KEY)


@pytest.mark.slow
def test_the_creature_end_to_end(creature) -> None:
    animation = creature.select([0, 8, 16])
    made = Recipe().build()
    marked = embed_animation(animation, made, "tsai2014", KEY).animation
    found = judge(extract(marked, made, "tsai2014"), KEY)
    assert found.log10_p < -6
    assert found.errors.maximum <= 0.1875
    assert judge(extract(animation, made, "tsai2014"), KEY).log10_p > -3
