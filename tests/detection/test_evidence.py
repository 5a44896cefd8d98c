from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from meshmark.detection.bit_error_rate import bit_errors
from meshmark.detection.decision import decide, shares
from meshmark.detection.evidence import STEPS, Evidence, RestoredVariant
from meshmark.detection.significance import SHORT_LIST, TOGETHER, judge, log10_p_of
from meshmark.extension.carrier import Carrier, measure, observation_of
from meshmark.keys import Key
from meshmark.statistics.p_values import word_log_e_means
from meshmark.statistics.word_windows import WordPosterior

KEY = Key(bytes(range(32)))
OTHER = Key(bytes(range(1, 33)))


def carrier(bins, place, n_bins=4) -> Carrier:
    bins = np.array(bins)
    return Carrier(np.arange(len(bins)), bins, np.array(place, dtype=float), n_bins, np.zeros(1))


def evidence(words, *, frames=3, noise=0.0, n_words=None, erase=(), tracked=True) -> Evidence:
    rng = np.random.default_rng(0)
    value = words + noise * rng.normal(size=(frames, *words.shape))
    for chip in erase:
        value[:, :, chip] = 0.0
    times = np.arange(1.0, frames + 1)
    n_words = len(words) if n_words is None else n_words
    return of_values(value, n_words, times, tracked)


def of_values(value, n_words, times, tracked=True) -> Evidence:
    variant = RestoredVariant.of(np.clip(value, -1, 1)[:, None], np.zeros(1))
    return Evidence("/A", "tsai2014", n_words, times, (variant,), tracked)


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


def test_chips_that_say_too_little_are_no_bits() -> None:
    rng = np.random.default_rng(5)
    words = rng.choice([-1, 1], size=(2, 16))
    # Clear where right, and feeble where wrong.
    soft = 0.9 * words.astype(float)
    soft[:, :3] = -0.3 * words[:, :3]
    variant = RestoredVariant.of(soft[None, None], np.zeros(1))
    item = Evidence("/A", "apex", 2, np.zeros(1), (variant,))
    assert bit_errors(item, words).maximum == pytest.approx(3 / 16)
    assert bit_errors(replace(item, bit_threshold=1 / 3), words).maximum == 0.0
    assert bit_errors(replace(item, bit_threshold=0.25), words).maximum == pytest.approx(3 / 16)
    # And a part of too few bits is left out.
    soft[:, :9] *= 0.3
    few = replace(
        item, variants=(RestoredVariant.of(soft[None, None], np.zeros(1)),), bit_threshold=1 / 3
    )
    assert np.isnan(bit_errors(few, words).per_frame).all()


def test_bit_errors_take_the_best_part_of_each_frame() -> None:
    words = KEY.words("tsai2014", 2, 16)
    value = np.tile(words.astype(float), (2, 1, 1))
    value[0, 0, :4] *= -1
    value[0, 1, :2] *= -1
    value[1, 1, :1] *= -1
    item = of_values(value, 2, np.array([1.0, 2.0]))
    errors = bit_errors(item, words)
    np.testing.assert_allclose(errors.per_frame, [2 / 16, 0.0])
    assert errors.average == pytest.approx(1 / 16)
    assert errors.maximum == pytest.approx(2 / 16)


def test_untracked_frames_are_taken_each_by_itself() -> None:
    words = KEY.words("tsai2014", 4, 16)
    value = np.tile(words[:2].astype(float), (4, 1, 1))
    # In the last frame, both carriers turn out to be other parts.
    value[3] = words[2:4]
    item = of_values(value, 4, np.arange(1.0, 5.0))
    tracked, untracked = bit_errors(item, words), bit_errors(replace(item, tracked=False), words)
    np.testing.assert_allclose(untracked.per_frame, 0.0)
    assert tracked.maximum > 0.2


def test_every_frame_is_read_in_its_own_way() -> None:
    rng = np.random.default_rng(3)
    words = KEY.words("apex", 8, 16)
    soft = rng.uniform(-0.9, 0.9, size=(4, 3, 2, 16))
    for t, reading in enumerate([0, 2, 1, 2]):
        soft[t, reading] = 0.9 * words[[3, 5]]
    where = WordPosterior(np.tile([3.0, 5.0], (3, 1)), np.full(2, 0.1))
    variant = RestoredVariant.of(soft, np.full(3, -np.log(3.0)), posteriors=(where,) * 4)
    item = Evidence("/A", "apex", 8, np.arange(4.0), (variant,))
    np.testing.assert_array_equal(bit_errors(item, words).per_frame, 0.0)


def test_a_frame_that_says_little_is_read_as_all_together() -> None:
    words = KEY.words("tsai2014", 4, 16)
    soft = np.zeros((4, 2, 4, 16))
    soft[:, 0] = 0.5 * words
    # In one frame another reading, loud but not quite right, speaks more for the words by luck.
    soft[2, 1] = 0.8 * words
    soft[2, 1, :, :2] *= -1.0
    item = Evidence(
        "/A", "tsai2014", 4, np.arange(4.0), (RestoredVariant.of(soft, np.log([0.5, 0.5])),)
    )
    np.testing.assert_array_equal(bit_errors(item, words).per_frame, 0.0)
    # Of frames that share no vertices, each may have been treated in another way.
    alone = bit_errors(replace(item, tracked=False), words)
    np.testing.assert_allclose(alone.per_frame, [0.0, 0.0, 1 / 8, 0.0])


def test_erasures_count_neither_way_and_mostly_erased_parts_not_at_all() -> None:
    words = KEY.words("tsai2014", 1, 16)
    value = np.tile(words.astype(float), (3, 1, 1))
    value[:, :, :2] = 0.0
    value[:, 0, 2] *= -1
    some = of_values(value, 1, np.arange(3.0))
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
    item = evidence(KEY.words("tsai2014", 8, 16), noise=1.0)
    alone = decide("f", [item], KEY).log10_p
    names = [f"recipient {i}" for i in range(99)]
    among_hundred = decide("f", [item], KEY, recipients=names)
    assert among_hundred.log10_p == pytest.approx(alone + 2)
    assert among_hundred.recipient is None
    assert decide("f", [item], KEY, n_schemes=10).log10_p == pytest.approx(alone + 1)
    assert decide("f", [item], KEY, share=0.1).log10_p == pytest.approx(alone + 1)
    silent = RestoredVariant.of(np.zeros((3, 1, 8, 16)), np.zeros(1))
    empty = Evidence("/B", "tsai2014", 8, item.times, (silent,))
    # What could never show anything costs nothing; what could, does.
    assert decide("f", [item, *[empty] * 300], KEY).log10_p == pytest.approx(alone)
    other = replace(evidence(OTHER.words("tsai2014", 8, 16), noise=1.0), prim="/B")
    both = decide("f", [item, other], KEY)
    assert both.log10_p - alone == pytest.approx(-shares([item, other])[0])
    assert 0.0 < both.log10_p - alone < 0.5
    assert np.sum(10.0 ** shares([item, other, empty])) == pytest.approx(1.0)
    # Verdicts tell what was paid.
    thrifty = decide("f", [item, other], KEY, recipients=names[:1], n_schemes=2, share=0.125)
    for verdict, tried in ((both, (1, 1, 2)), (among_hundred, (1, 100, 1)), (thrifty, (2, 2, 2))):
        [searched] = verdict.searched
        assert (searched.schemes, searched.names, searched.candidates) == tried
        assert verdict.log10_p - searched.log10_factor == pytest.approx(alone)


def test_the_recipient_whose_words_fit_is_named() -> None:
    item = evidence(KEY.words("tsai2014", 8, 16, "studio east"))
    verdict = decide("f", [item], KEY, recipients=["studio west", "studio east"])
    assert (verdict.verdict, verdict.recipient) == ("marked", "studio east")
    assert decide("f", [item], KEY).verdict == "not marked"


@pytest.mark.slow
def test_p_of_unmarked_evidence_is_honest_over_keys() -> None:
    item = evidence(np.zeros((6, 16), dtype=int), noise=1.0, n_words=8)
    keys = [Key(bytes([i]) * 32) for i in range(200)]
    p = np.array([judge(item, key).log10_p for key in keys])
    for alpha in (0.3, 0.1):
        assert np.mean(p <= np.log10(alpha)) <= alpha + 4 * np.sqrt(alpha * (1 - alpha) / len(p))


def test_evidence_is_kept_in_steps_and_erasures_stay_erasures() -> None:
    soft = np.array([-1.0, -0.5, -1e-5, 0.0, 1e-5, 0.3, 1.0]).reshape(1, 1, 1, 7)
    variant = RestoredVariant.of(soft, np.zeros(1))
    np.testing.assert_allclose(variant.frames[0].steps / STEPS, soft[0], atol=1 / STEPS)
    np.testing.assert_array_equal(np.sign(variant.frames[0].steps), np.sign(soft[0]))


@pytest.mark.parametrize("tracked", [True, False])
def test_frames_that_disagree_on_the_reading_speak_each_by_itself(tracked) -> None:
    words = KEY.words("tsai2014", 4, 16)
    # Every frame is right under a reading of its own, and noise under the others.
    rng = np.random.default_rng(3)
    soft = np.clip(rng.normal(size=(4, 4, 4, 16)), -1, 1)
    soft[np.arange(4), np.arange(4)] = words
    variant = RestoredVariant.of(soft, np.log(np.full(4, 0.25)))
    item = Evidence("/A", "tsai2014", 4, np.arange(4.0), (variant,), tracked)
    together = -word_log_e_means(variant.pooled, variant.belief, words) / np.log(10)
    assert judge(item, KEY).log10_p < together - 3
    assert judge(item, KEY).log10_p < -6 < -2 < judge(item, OTHER).log10_p


def peak_of_judging(frames: int) -> int:
    """Bytes that judging so many frames, 64 readings each, takes beside the evidence."""
    rng = np.random.default_rng(7)
    soft = rng.uniform(-1, 1, size=(frames, 64, 8, 16))
    where = WordPosterior(np.tile(np.arange(8.0), (64, 1)), np.full(8, 0.2))
    variant = RestoredVariant.of(soft, np.full(64, -np.log(64.0)), posteriors=(where,) * frames)
    item = Evidence("/A", "apex", 16, np.arange(float(frames)), (variant,))
    tracemalloc.start()
    judge(item, KEY)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak


def test_judging_many_frames_takes_no_more_memory_than_few() -> None:
    # What is left to grow are the places of all frames, 4 kB each, which a median is taken of.
    assert peak_of_judging(40) < peak_of_judging(4) + 36 * 8_000


def many_ways(*, tracked=True) -> Evidence:
    """Three frames of noise, seen as they stand and restored, under three readings each."""
    soft = np.clip(np.random.default_rng(7).normal(size=(2, 3, 3, 4, 16)), -1, 1)
    variants = tuple(
        RestoredVariant.of(soft[i], np.log([0.6, 0.3, 0.1]), restored, float(np.log(belief)))
        for i, (restored, belief) in enumerate([(0, 0.7), (30, 0.3)])
    )
    return Evidence("/A", "tsai2014", 4, np.arange(3.0), variants, tracked)


@pytest.mark.parametrize("tracked", [True, False])
def test_p_is_honest_over_readings_strands_and_frames(tracked) -> None:
    n = 2000
    words = 2 * np.random.default_rng(2).integers(0, 2, size=(n, 4, 16)) - 1
    p = log10_p_of(many_ways(tracked=tracked), words)
    assert np.all(p <= 0)
    for alpha in (0.5, 0.1, 0.01):
        assert np.mean(p <= np.log10(alpha)) <= alpha + 5 * np.sqrt(alpha * (1 - alpha) / n)


def e_value(evidence, words) -> np.ndarray:
    return 10.0 ** -log10_p_of(evidence, words)


def test_strands_share_their_belief() -> None:
    words = KEY.words("tsai2014", 4, 16)
    near, far = 0.5 * words[None, None], 0.3 * words[None, None]
    times, sure = np.array([1.0]), np.zeros(1)

    def seen(*variants) -> float:
        item = Evidence("/A", "tsai2014", 4, times, variants)
        return float(e_value(item, words[None])[0])

    one, two = seen(RestoredVariant.of(near, sure)), seen(RestoredVariant.of(far, sure))
    both = seen(
        RestoredVariant.of(near, sure, 0, float(np.log(0.7))),
        RestoredVariant.of(far, sure, 30, float(np.log(0.3))),
    )
    assert min(one, two) > 100
    assert both == pytest.approx(0.7 * one + 0.3 * two)


@pytest.mark.parametrize("tracked", [True, False])
def test_frames_share_belief_with_all_together(tracked) -> None:
    words = KEY.words("tsai2014", 4, 16)
    strength = np.array([0.5, 0.7, 0.6])
    value = strength[:, None, None] * words
    item = of_values(value, 4, np.arange(3.0), tracked)
    (variant,) = item.variants
    together = np.exp(word_log_e_means(variant.pooled, variant.belief, words))
    alone = [e_value(item.select([t]), words[None])[0] for t in range(3)]
    assert min(alone) > 100
    expected = TOGETHER * together + (1.0 - TOGETHER) * np.mean(alone)
    assert e_value(item, words[None])[0] == pytest.approx(expected)


@pytest.mark.parametrize("tracked", [True, False])
def test_one_of_two_hundred_recipients_is_named(tracked) -> None:
    names = [f"studio {i}" for i in range(200)]
    words = KEY.words("tsai2014", 8, 16, "studio 137")
    item = replace(evidence(words[:5], noise=1.0, n_words=8), tracked=tracked)
    verdict = decide("f", [item], KEY, recipients=names)
    assert (verdict.verdict, verdict.recipient) == ("marked", "studio 137")
    alone = judge(item, KEY, "studio 137").log10_p
    assert verdict.log10_p == pytest.approx(alone + np.log10(201))


def test_only_the_best_are_tried_on_each_frame_by_itself() -> None:
    item = many_ways(tracked=False)
    words = 2 * np.random.default_rng(3).integers(0, 2, size=(50, 4, 16)) - 1
    tracked = log10_p_of(replace(item, tracked=True), words)
    listed = np.argsort(tracked, kind="stable")[:SHORT_LIST]
    p, each = log10_p_of(item, words), np.array([log10_p_of(item, w[None])[0] for w in words])
    np.testing.assert_allclose(p[listed], each[listed], atol=1e-12)
    # Whoever is not on the list is believed less, never more.
    assert np.all(p >= each - 1e-12)


def test_carriers_become_evidence_by_their_strength() -> None:
    seen = observation_of([carrier([0, 1, 2], [0.52, 0.4, 0.5])], 0.05)
    np.testing.assert_allclose(seen.soft, [[[0.4, -1.0, 0.0, 0.0]]], atol=1e-12)
