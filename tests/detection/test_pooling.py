"""Evidence of several meshes, put together: it adds up, and random keys gain nothing by it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshmark.detection.decision import decide
from meshmark.detection.evidence import Evidence, InformedFacts, RestoredVariant
from meshmark.detection.pooling import POOLED_SHARE, Pool, pools
from meshmark.detection.significance import log10_p_of
from meshmark.keys import Key
from meshmark.statistics.p_values import word_log_e_means
from meshmark.statistics.word_windows import WordPosterior

KEY, OTHER = Key(bytes(range(32))), Key(bytes(range(1, 33)))
N_WORDS, K = 96, 16
FACTS = InformedFacts("/A", (0.0,), ("similarity",), "identity", 1e-5, 1.0, 100)


def worded(
    positions: Sequence[float], signal: float, seed: int = 0, part: str = "", noise: float = 0.4
) -> Evidence:
    """Let carriers hold the words at some positions of the list, under the first of hypotheses."""
    rng = np.random.default_rng(seed)
    at = np.asarray(positions, dtype=np.float64)
    soft = rng.normal(0.0, noise, (1, 3, len(at), K))
    soft[0, 0] += signal * KEY.words("apex", N_WORDS, K)[at.astype(int)]
    posterior = WordPosterior(np.tile(at, (3, 1)), np.full(len(at), 0.15))
    beliefs = np.log([0.6, 0.3, 0.1])
    variant = RestoredVariant.of(np.clip(soft, -1.0, 1.0), beliefs, posteriors=[posterior])
    return Evidence(f"/{seed}", "apex", N_WORDS, np.ones(1), (variant,), part=part)


def shared(
    n_chips: int, signal: float, seed: int = 0, hypotheses: Sequence[float] = (0.6, 0.3, 0.1)
) -> Evidence:
    """Let all chips hold one word, as an informed scheme's do."""
    rng = np.random.default_rng(seed)
    soft = rng.normal(0.0, 0.25, (1, len(hypotheses), 1, n_chips))
    soft += signal * KEY.words("relief", 1, n_chips)
    variant = RestoredVariant.of(np.clip(soft, -1.0, 1.0), np.log(hypotheses))
    return Evidence(f"/{seed}", "relief", 1, np.ones(1), (variant,), informed=FACTS)


def pool(*items: Evidence) -> Pool:
    [found] = pools(items)
    return found


def words(keys: Sequence[Key], found: Pool) -> np.ndarray:
    return np.concatenate(
        [key.words_of(found.scheme, found.n_words, found.n_chips, (None,)) for key in keys]
    )


def multiplied(items: Sequence[Evidence]) -> float:
    """Multiply e-values of the key on meshes as if they were independent, -log10."""
    of_key = KEY.words("apex", N_WORDS, K)
    variants = [item.variants[0] for item in items]
    log_e = [word_log_e_means(v.pooled, v.belief, of_key, v.posterior) for v in variants]
    return -float(np.sum(log_e)) / np.log(10.0)


def test_meshes_that_say_the_same_say_it_once() -> None:
    for item in (worded((10, 40, 70), 0.5), shared(150, 0.1)):
        found = pool(item, item, item)
        [alone] = log10_p_of(item, words([KEY], found))
        [together] = found.log10_p(words([KEY], found))
        assert together == pytest.approx(alone, abs=1e-9)
        assert found.reachable_log10_p == pytest.approx(item.reachable_log10_p)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 1000))
def test_e_values_of_meshes_that_hold_other_words_multiply(seed: int) -> None:
    items = [worded((at, at + 9), 0.5, seed + at) for at in (10, 40, 70)]
    found = pool(*items)
    [log10_p] = found.log10_p(words([KEY], found))
    # It costs something that any of them may be destroyed, and to leave small terms out.
    assert multiplied(items) < log10_p < multiplied(items) + 3.0


def test_a_word_that_two_hold_counts_for_one() -> None:
    """Its e-values on both depend on each other."""
    items = [worded(at, 1.0, noise=0.0) for at in ((10, 30, 50), (10, 70, 84))]
    found = pool(*items)
    [log10_p] = found.log10_p(words([KEY], found))
    # A word of 16 chips is worth 4.8 decades.
    assert multiplied(items) + 4.0 < log10_p < multiplied(items) + 7.0


def test_weak_meshes_add_up_to_a_strong_verdict() -> None:
    alike = [worded((10, 25, 40, 60), 0.23, seed) for seed in range(6)]
    unlike = [worded((4 + 12 * n, 9 + 12 * n), 0.45, n) for n in range(7)]
    one_word = [shared(150 + 10 * seed, 0.06, seed) for seed in range(12)]
    for items in (alike, unlike, one_word):
        each = [decide("a", [item], KEY).log10_p for item in items]
        assert -3.5 < np.median(each) < -1.0
        verdict = decide("a", items, KEY)
        assert (verdict.verdict, verdict.recipient) == ("marked", None)
        [told] = verdict.pooled
        assert told.meshes == len(items)
        assert verdict.log10_p == told.log10_p < -9.0
        other = decide("a", items, OTHER)
        assert other.verdict == "not marked"
        assert other.log10_p > -2.0


def test_unmarked_meshes_add_up_to_nothing() -> None:
    for items in (
        [worded((10, 25, 40, 60), 0.0, seed) for seed in range(6)],
        [worded((4 + 12 * n, 9 + 12 * n), 0.0, n) for n in range(7)],
        [shared(150, 0.0, seed) for seed in range(12)],
    ):
        verdict = decide("a", items, KEY)
        assert verdict.verdict == "not marked"
        assert verdict.log10_p > -2.0


def test_the_recipient_whose_words_are_in_all_of_them_is_named() -> None:
    mine = [shared(150, 0.0, seed) for seed in range(12)]
    theirs = KEY.words("relief", 1, 150, "acme")
    items = []
    for item in mine:
        [variant] = item.variants
        soft = np.clip(variant.pooled[None] + 0.07 * theirs, -1.0, 1.0)
        of_theirs = RestoredVariant.of(soft, variant.log_prior)
        items.append(Evidence(item.prim, "relief", 1, np.ones(1), (of_theirs,), informed=FACTS))
    verdict = decide("a", items, KEY, recipients=["bob", "acme"])
    assert (verdict.verdict, verdict.recipient) == ("marked", "acme")
    assert [named.recipient for named in verdict.recipients] == ["acme"]


def test_several_meshes_cost_one_of_them_half_the_rate() -> None:
    item, empty = shared(150, 0.1), shared(0, 0.0, 1)
    alone = decide("a", [item], KEY)
    assert alone.pooled == ()
    assert decide("a", [item, empty], KEY).log10_p == pytest.approx(alone.log10_p)
    # Two that reach equally far share the other half.
    verdict = decide("a", [item, shared(150, 0.0, 1)], KEY)
    paid = alone.log10_p - np.log10((1.0 - POOLED_SHARE) / 2)
    assert min(prim.log10_p for prim in verdict.prims) == pytest.approx(paid)


def test_meshes_with_other_hypotheses_are_pooled_by_the_chips_they_tell_of() -> None:
    """One copy was smoothed and has been read in two ways, say; chips are the owner's, or all."""
    few, many = shared(64, 0.3, 1, (0.7, 0.3)), shared(64, 0.3, 2, (0.4, 0.3, 0.2, 0.1))
    owner = np.arange(64) % 8 == 0
    items = []
    for item, of_owner in ((few, [0]), (many, [0, 2])):
        [variant] = item.variants
        soft = variant.pooled.copy()
        soft[of_owner] = np.where(owner, soft[of_owner], 0.0)
        only = RestoredVariant.of(soft[None], variant.log_prior)
        items.append(Evidence(item.prim, "relief", 1, np.ones(1), (only,), informed=FACTS))
    S, belief = pool(*items).shared
    assert S.shape == (2, 64)
    np.testing.assert_allclose(np.exp(belief), [0.7, 0.3])
    first, second = (item.variants[0].pooled[:, 0] for item in items)
    of_owner = (first[0] + (0.4 * second[0] + 0.2 * second[2]) / 0.6) / 2.0
    np.testing.assert_allclose(S[0], of_owner, atol=1e-12)
    assert not S[0, ~owner].any()


def test_meshes_are_pooled_and_so_are_their_surfaces() -> None:
    joined, apart = worded((10, 30), 0.3, 0), worded((50, 70), 0.3, 1)
    parts = [worded((at,), 0.3, 0, f"surface {n}") for n, at in enumerate((10, 30), start=1)]
    run = worded((10, 30), 0.3, 0, "surfaces 1, 2")
    meshes, surfaces = pools([joined, apart, *parts, run])
    assert [item.part for item in meshes.evidence] == ["", ""]
    assert [item.part for item in surfaces.evidence] == ["", "surface 1", "surface 2"]
    assert surfaces.evidence[0].prim == apart.prim
    # A body on a ground: one mesh, two surfaces.
    [only] = pools([joined, *parts])
    assert [item.part for item in only.evidence] == ["surface 1", "surface 2"]
    assert pools([joined]) == []


@pytest.mark.parametrize("n_keys", [200, pytest.param(5000, marks=pytest.mark.slow)])
def test_of_random_keys_no_more_than_a_share_a_have_p_of_a(n_keys: int) -> None:
    """On meshes that bear another's mark, whose evidence is anything but independent."""
    keys = [Key(np.random.default_rng(n).bytes(32)) for n in range(n_keys)]
    for items in (
        [worded((10, 25, 40, 60), 0.4, seed % 2) for seed in range(6)],
        [worded((10 + 3 * n, 25, 40 + 5 * n), 0.4, n % 3) for n in range(6)],
        [shared(40 + 10 * (seed % 3), 0.1, seed % 3) for seed in range(12)],
    ):
        found = pool(*items)
        p = 10.0 ** found.log10_p(words(keys, found))
        for a in (0.1, 0.01, 0.001):
            assert np.mean(p <= a) <= a + 3.0 * np.sqrt(a / n_keys)
