"""What a copy says alone, and what it says beside its original: p-values that multiply."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from meshmark.detection.decision import decide
from meshmark.detection.evidence import Evidence, InformedFacts, RestoredVariant
from meshmark.detection.joint_verdict import jointly
from meshmark.detection.significance import HypothesisResult
from meshmark.detection.verdict import InformedVerdict, Named, PrimVerdict, Verdict
from meshmark.keys import Key

FPR = 1e-6
FACTS = InformedFacts("/A", (0.0,), ("similarity",), "identity", 1e-5, 1.0, 100)
LOG10_P = st.floats(-30.0, 0.0)


def answer(log10_p: float) -> str:
    return "marked" if log10_p <= np.log10(FPR) else "not marked"


def prim(name, log10_p, informed=False, chips=100, named=()) -> PrimVerdict:
    return PrimVerdict(
        prim=name,
        scheme="relief" if informed else "apex",
        verdict=answer(log10_p),
        log10_p=log10_p,
        recipient=None,
        chips=chips,
        times=(1.0,),
        finding=HypothesisResult.of_nothing(1),
        recipients=tuple(named),
        informed=InformedVerdict(log10_p, FACTS) if informed else None,
    )


def verdict(*prims: PrimVerdict) -> Verdict:
    best = min((each.log10_p for each in prims), default=0.0)
    named = tuple(each for one in prims for each in one.recipients)
    said = answer(best) if prims else "inconclusive"
    whose = named[0].recipient if named else None
    return Verdict("copy.usda", said, best, whose, 0.0, prims, recipients=named)


def joint(*log10_p: float) -> float:
    """The best of each and of their product, corrected for both."""
    q = 10.0 ** sum(log10_p)
    return min(0.0, float(np.log10(3.0 * min(q * (1.0 - np.log(q)), *(10.0**p for p in log10_p)))))


def test_the_product_of_two_independent_p_is_as_rare_as_that() -> None:
    one, two = np.random.default_rng(0).random((2, 200_000))
    q = one * two
    for alpha in (0.3, 0.03, 0.003):
        assert np.mean(q * (1.0 - np.log(q)) <= alpha) == pytest.approx(alpha, rel=0.1)


@example(0.0, -6.3)
@example(-6.3, 0.0)
@given(LOG10_P, LOG10_P)
def test_the_best_of_both_and_of_their_product_is_corrected_for_three(
    one: float, two: float
) -> None:
    found = jointly(verdict(prim("/A", one)), verdict(prim("/A", two, informed=True)), FPR)
    expected = joint(one, two)
    assert found.log10_p == pytest.approx(expected)
    assert found.verdict == answer(found.log10_p)
    [both] = found.prims
    assert both.log10_p == pytest.approx(expected)
    assert both.verdict == found.verdict
    assert both.informed is not None
    assert both.informed.log10_p == two


@given(LOG10_P, LOG10_P, LOG10_P)
def test_of_several_meshes_the_best_of_both_kinds_multiply(a: float, b: float, c: float) -> None:
    blind = verdict(prim("/A", a), prim("/B", b))
    found = jointly(blind, verdict(prim("/A", c, informed=True)), FPR)
    assert found.log10_p == pytest.approx(joint(min(a, b), c))
    by_prim = {each.prim: each for each in found.prims}
    assert by_prim["/A"].log10_p == pytest.approx(joint(a, c))
    assert all(each.verdict == answer(each.log10_p) for each in found.prims)
    # No mesh alone says more than all together.
    assert found.log10_p <= min(each.log10_p for each in found.prims) + 1e-9


def test_what_either_says_well_is_not_lost_beside_what_the_other_does_not() -> None:
    for pair in ((-6.6, 0.0), (0.0, -6.6)):
        assert joint(*pair) == pytest.approx(-6.6 + np.log10(3.0))
    # Two that say too little each say enough together.
    assert joint(-4.5, -4.5) < -6.0


def test_a_copy_that_lies_nowhere_is_inconclusive_unless_it_is_marked_alone() -> None:
    assert jointly(verdict(prim("/A", -1.0)), verdict(), FPR).verdict == "inconclusive"
    assert jointly(verdict(prim("/A", -7.0)), verdict(), FPR).verdict == "marked"
    assert jointly(verdict(), verdict(), FPR).verdict == "inconclusive"


def test_names_of_both_are_kept_where_their_own_p_bears_it() -> None:
    near, far = Named("near", -6.1), Named("far", -9.0)
    blind = verdict(prim("/A", -6.1, named=[near]))
    found = jointly(blind, verdict(prim("/A", -9.0, informed=True, named=[far])), FPR)
    assert (found.verdict, found.recipient) == ("marked", "far")
    # Each had a rate of its own; of two together, -6.1 is too weak.
    assert [named.recipient for named in found.recipients] == ["far"]
    assert found.recipients[0].log10_p <= np.log10(FPR)


def evidence(rng, name: str, n_words: int, n_chips: int) -> Evidence:
    soft = rng.normal(0.0, 0.4, (1, 2, max(1, n_words // 2), n_chips))
    variant = RestoredVariant.of(np.clip(soft, -1, 1), np.log([0.5, 0.5]))
    facts = FACTS if n_words == 1 else None
    return Evidence("/A", name, n_words, np.ones(1), (variant,), informed=facts)


def test_of_random_keys_no_more_than_a_share_a_have_p_of_a() -> None:
    rng = np.random.default_rng(0)
    alone, beside = evidence(rng, "apex", 4, 16), evidence(rng, "relief", 1, 200)
    p = []
    for _ in range(200):
        key = Key(rng.bytes(32))
        # A lax rate, so that both sides of it are seen.
        one, two = (decide("copy.usda", [item], key, fpr=0.1) for item in (alone, beside))
        joint = jointly(one, two, 0.1)
        assert (joint.verdict == "marked") == (joint.log10_p <= -1.0)
        p.append(joint.log10_p)
    for rate in (0.5, 0.1):
        share = np.mean(np.array(p) <= np.log10(rate))
        assert share <= rate + 3.0 * np.sqrt(rate / len(p))
