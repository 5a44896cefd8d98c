from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshmark.carrier import Carrier, measure
from meshmark.detection import Sighting, aligned
from meshmark.errors import CapacityError
from meshmark.evidence import Evidence, bit_errors, judge
from meshmark.keys import Key
from meshmark.verdict import decide

KEY = Key(bytes(range(32)))
OTHER = Key(bytes(range(1, 33)))


def carrier(bins, place, n_bins=4) -> Carrier:
    bins = np.array(bins)
    return Carrier(np.arange(len(bins)), bins, np.array(place, dtype=float), n_bins, np.zeros(1))


def evidence(words, *, frames=3, noise=0.0, n_words=None, erase=()) -> Evidence:
    rng = np.random.default_rng(0)
    value = 0.05 * words + noise * rng.normal(size=(frames, *words.shape))
    held = np.ones(value.shape, dtype=bool)
    for chip in erase:
        held[:, :, chip], value[:, :, chip] = False, 0.0
    times = np.arange(1.0, frames + 1)
    n_words = len(words) if n_words is None else n_words
    return Evidence("/A", "tsai2014", n_words, times, value, held, 0.05)


def test_a_chip_is_the_mean_place_less_one_half() -> None:
    chips = measure([carrier([0, 0, 1, 3, -1], [0.2, 0.4, 1.0, 0.5, 0.9])])
    np.testing.assert_allclose(chips.value, [[-0.2, 0.5, 0.0, 0.0]], atol=1e-15)
    assert chips.count.tolist() == [[2, 1, 0, 1]]
    # An empty bin says nothing, where a balanced one says zero.
    assert chips.held.tolist() == [[True, True, False, True]]


def test_perfect_evidence_is_found_in_any_order_of_the_parts() -> None:
    words = KEY.words("tsai2014", 8, 16)
    found = judge(evidence(words[[5, 0, 3, 7]], n_words=8), KEY)
    assert found.log10_p < -12
    assert found.errors.average == found.errors.maximum == 0.0
    np.testing.assert_allclose(found.log10_p_per_frame, found.log10_p)
    assert judge(evidence(words[[5, 0, 3, 7]], n_words=8), OTHER).log10_p > -2


def test_bit_errors_take_the_best_part_of_each_frame() -> None:
    words = KEY.words("tsai2014", 2, 16)
    item = evidence(words, frames=2)
    item.value[0, 0, :4] *= -1
    item.value[0, 1, :2] *= -1
    item.value[1, 1, :1] *= -1
    errors = bit_errors(item, words)
    np.testing.assert_allclose(errors.per_frame, [2 / 16, 0.0])
    assert errors.average == pytest.approx(1 / 16)
    assert errors.maximum == pytest.approx(2 / 16)


def test_untracked_frames_are_taken_each_by_itself() -> None:
    words = KEY.words("tsai2014", 4, 16)
    item = evidence(words[:2], frames=4, n_words=4)
    # In the last frame, both carriers turn out to be other parts.
    item.value[3, 0] = 0.05 * words[2]
    item.value[3, 1] = 0.05 * words[3]
    tracked, untracked = bit_errors(item, words), bit_errors(replace(item, tracked=False), words)
    np.testing.assert_allclose(untracked.per_frame, 0.0)
    assert tracked.maximum > 0.2


def test_erasures_count_neither_way_and_mostly_erased_parts_not_at_all() -> None:
    words = KEY.words("tsai2014", 1, 16)
    some = evidence(words, erase=(0, 1))
    some.value[:, 0, 2] *= -1
    np.testing.assert_allclose(bit_errors(some, words).per_frame, 1 / 14)
    most = evidence(words, erase=tuple(range(9)))
    assert np.isnan(bit_errors(most, words).per_frame).all()
    assert np.isnan(bit_errors(most, words).average)


def test_verdicts_follow_p_and_what_could_be_reached() -> None:
    words = KEY.words("tsai2014", 8, 16)
    assert decide("f", [evidence(words)], KEY).verdict == "marked"
    assert decide("f", [evidence(words)], OTHER).verdict == "not marked"
    shared = evidence(words[:1], n_words=1)
    assert decide("f", [shared], KEY).verdict == "inconclusive"
    assert decide("f", [shared], KEY, fpr=1e-4).verdict == "marked"
    assert decide("f", [shared], OTHER, fpr=1e-4).verdict == "not marked"
    assert decide("f", [], KEY).verdict == "inconclusive"


def test_every_hypothesis_is_paid_for() -> None:
    item = evidence(KEY.words("tsai2014", 8, 16), noise=0.05)
    alone = decide("f", [item], KEY).log10_p
    names = [f"recipient {i}" for i in range(99)]
    among_hundred = decide("f", [item], KEY, recipients=names)
    assert among_hundred.log10_p == pytest.approx(alone + 2)
    assert among_hundred.recipient is None
    assert decide("f", [item], KEY, n_schemes=10).log10_p == pytest.approx(alone + 1)
    empty = Evidence("/B", "tsai2014", 8, item.times, 0 * item.value, item.held, 0.05)
    assert decide("f", [item, empty], KEY).log10_p == pytest.approx(alone + np.log10(2))


def test_the_recipient_whose_words_fit_is_named() -> None:
    item = evidence(KEY.words("tsai2014", 8, 16, "studio east"))
    verdict = decide("f", [item], KEY, recipients=["studio west", "studio east"])
    assert (verdict.verdict, verdict.recipient) == ("marked", "studio east")
    assert decide("f", [item], KEY).verdict == "not marked"


def test_p_of_unmarked_evidence_is_honest_over_keys() -> None:
    item = evidence(np.zeros((6, 16), dtype=int), noise=0.05, n_words=8)
    keys = [Key(bytes([i]) * 32) for i in range(200)]
    p = np.array([judge(item, key).log10_p for key in keys])
    for alpha in (0.3, 0.1):
        assert np.mean(p <= np.log10(alpha)) <= alpha + 4 * np.sqrt(alpha * (1 - alpha) / len(p))


def sighting(descriptors, values) -> Sighting:
    chips = measure([carrier([0, 1, 2, 3], np.full(4, 0.5 + v)) for v in values])
    return Sighting(chips, np.array(descriptors, dtype=float)[:, None])


def test_carriers_are_matched_by_shape_when_vertices_are_not() -> None:
    first = sighting([1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    shuffled = sighting([3.02, 1.01, 2.03], [0.3, 0.1, 0.2])
    fewer = sighting([2.9], [0.3])
    chips = aligned([first, shuffled, None, fewer])
    np.testing.assert_allclose(chips[1].value, first.chips.value)
    assert not chips[2].held.any()
    assert chips[3].held.all(axis=1).tolist() == [False, False, True]


def test_nothing_seen_at_all_is_no_evidence() -> None:
    with pytest.raises(CapacityError, match="no carrier"):
        aligned([None, None])
