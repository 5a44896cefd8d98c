from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.detection.carrier_matching import Aligned, aligned, by_looks, by_place, in_order
from meshmark.errors import CapacityError
from meshmark.extension.carrier import Observation
from meshmark.statistics.word_windows import WordPosterior

RNG = np.random.default_rng(0)
SOFT = RNG.uniform(-1, 1, size=(2, 3, 8))
SHAPES = np.array([[0.02, 0.9], [0.02, 0.9], [0.1, 0.7]])


def observation(carriers, *, shapes=SHAPES, vertices=None) -> Observation:
    carriers = list(carriers)
    placed = None if vertices is None else np.array(vertices)
    return Observation(SOFT[:, carriers], np.log([0.5, 0.5]), shapes[carriers], placed)


def soft_of(found: Aligned) -> np.ndarray:
    return np.array([frame.steps for frame in found.frames])


def test_a_common_layout_keeps_the_order() -> None:
    found = aligned([observation([0, 1, 2]), observation([0, 1, 2])], in_order)
    np.testing.assert_allclose(soft_of(found), np.stack([SOFT, SOFT]), atol=1e-6)
    np.testing.assert_allclose(np.exp(found.log_prior), [0.5, 0.5])
    assert [frame.posterior for frame in found.frames] == [None, None]


def test_left_is_told_from_right_by_what_it_says() -> None:
    soft = soft_of(aligned([observation([0, 1, 2]), observation([2, 1, 0])], by_looks))
    np.testing.assert_allclose(soft[1], SOFT, atol=1e-6)


def test_a_missing_carrier_is_an_erasure() -> None:
    soft = soft_of(aligned([observation([0, 1, 2]), None, observation([2])], by_looks))
    assert not soft[1].any()
    assert soft[2].any(axis=(0, 2)).tolist() == [False, False, True]


def test_places_match_near_vertices_and_no_others() -> None:
    points = np.array([[0.0, 0, 0], [0.01, 0, 0], [1.0, 0, 0], [1.0, 1, 0], [0.5, 0.5, 0]])
    match = by_place(points)
    whole = observation([0, 1, 2], vertices=[0, 2, 3])
    moved = observation([1, 0], vertices=[2, 1])
    astray = observation([1], vertices=[4])
    soft = soft_of(aligned([whole, moved, astray], match))
    np.testing.assert_allclose(soft[1][:, :2], SOFT[:, :2], atol=1e-6)
    assert not soft[1][:, 2].any()
    assert not soft[2].any()


def test_places_of_words_go_with_their_carriers() -> None:
    place = np.array([[1.0, 2.0, 3.0], [1.5, 2.5, 3.5]])
    whole = replace(
        observation([0, 1, 2]), posterior=WordPosterior(place, np.array([0.1, 0.2, 0.3]))
    )
    some = replace(
        observation([2, 1]), posterior=WordPosterior(place[:, [2, 1]], np.array([0.5, 0.6]))
    )
    found = [frame.posterior for frame in aligned([whole, None, some], by_looks).frames]
    np.testing.assert_array_equal(found[0].position, place)
    assert np.isnan(found[1].position).all()
    np.testing.assert_array_equal(found[2].position[:, 1:], place[:, 1:])
    assert np.isnan(found[2].position[:, 0]).all()
    assert found[2].p_null.tolist() == [1.0, 0.6, 0.5]


def test_nothing_seen_at_all_is_no_evidence() -> None:
    with pytest.raises(CapacityError, match="no carrier"):
        aligned([None, None], by_looks)
