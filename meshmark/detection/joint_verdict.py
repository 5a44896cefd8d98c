"""How verdicts on one source are joined, and what that costs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.detection.verdict import Answer, Named, PooledVerdict, PrimVerdict, Verdict

# Log10 of what the best of three bounds is corrected by: blind, informed, and both together.
TRIPLE = float(np.log10(3.0))


def together(one: Verdict, two: Verdict) -> Verdict:
    """Join two verdicts on one source that share a false-positive rate: the lower p of each."""
    best = min(one, two, key=lambda verdict: verdict.log10_p)
    by_prim: dict[str, PrimVerdict] = {}
    for prim in (*one.prims, *two.prims):
        known = by_prim.get(prim.prim, prim)
        by_prim[prim.prim] = replace(
            min(known, prim, key=lambda prim: prim.log10_p),
            recipients=best_of_each((*known.recipients, *prim.recipients)),
        )
    return replace(
        best,
        prims=tuple(by_prim.values()),
        recipients=best_of_each((*one.recipients, *two.recipients)),
        pooled=best_of_each_scheme((*one.pooled, *two.pooled)),
    )


def jointly(blind: Verdict, informed: Verdict, fpr: float) -> Verdict:
    """Join what a copy says by itself with what it says beside its original.

    Notes
    -----
    The keys of both layers are independent of each other, and so are their p. The product of two
    independent p is at most q with a probability of at most q (1 - log q) [1]_. Of that, and each
    by itself, the best counts, three times (union bound).

    References
    ----------
    .. [1] R. A. Fisher, "Statistical methods for research workers", 4th edition, 1932, section
       21.1.
    """
    log10_fpr = float(np.log10(fpr))
    alone = {prim.prim: prim for prim in blind.prims}
    beside = {prim.prim: prim for prim in informed.prims}
    prims = tuple(
        _joint_prim(alone.get(name), beside.get(name), log10_fpr) for name in {**alone, **beside}
    )
    log10_p = _joint((blind.log10_p, informed.log10_p))
    answer = _answer(log10_p, informed.verdict, log10_fpr)
    names = _named((*blind.recipients, *informed.recipients), log10_fpr)
    recipients = names if answer == "marked" else ()
    return replace(
        informed,
        verdict=answer,
        log10_p=log10_p,
        recipient=recipients[0].recipient if recipients else None,
        prims=prims,
        notes=tuple(dict.fromkeys((*blind.notes, *informed.notes))),
        recipients=recipients,
        pooled=(*blind.pooled, *informed.pooled),
        looks=blind.looks,
        ended=blind.ended,
        searched=(*blind.searched, *informed.searched),
    )


def _joint_prim(
    blind: PrimVerdict | None, informed: PrimVerdict | None, log10_fpr: float
) -> PrimVerdict:
    """Join what one mesh says by itself with what it says beside its original."""
    both = [prim for prim in (blind, informed) if prim is not None]
    log10_p = _joint([prim.log10_p for prim in both])
    return replace(
        min(both, key=lambda prim: prim.log10_p),
        log10_p=log10_p,
        verdict=_answer(log10_p, both[-1].verdict, log10_fpr),
        recipients=_named((named for prim in both for named in prim.recipients), log10_fpr),
        informed=None if informed is None else informed.informed,
    )


def _joint(each: Sequence[float]) -> float:
    """Bound log10 p by the best of both and of their product."""
    return float(joint_log10_p(np.array(each)))


def joint_log10_p(each: FloatArray) -> FloatArray:
    """Bound log10 p, (...), by the best of each (k, ...) and of their product, where k is 1 or 2.

    See `jointly`.
    """
    log10_q = each.sum(axis=0)
    product = log10_q + np.log10(1.0 - log10_q * np.log(10.0))
    return np.minimum(0.0, TRIPLE + np.minimum(product, each.min(axis=0)))


def paid_for(verdict: Verdict, times: float) -> Verdict:
    """Correct a verdict for being the best of so many, by the union bound.

    What counts as marked is not told again: a share of the rate has to have been asked for.
    """
    more = float(np.log10(times))

    def paid(log10_p: float) -> float:
        return min(0.0, log10_p + more)

    named = tuple(replace(one, log10_p=paid(one.log10_p)) for one in verdict.recipients)
    return replace(verdict, log10_p=paid(verdict.log10_p), recipients=named)


def _answer(log10_p: float, otherwise: Answer, log10_fpr: float) -> Answer:
    """Answer by the joint p; what was marked before it was corrected is not marked."""
    if log10_p <= log10_fpr:
        return "marked"
    return "not marked" if otherwise == "marked" else otherwise


def _named(named: Iterable[Named], log10_fpr: float) -> tuple[Named, ...]:
    """Keep those whose p still bears it when it is corrected like the best of three."""
    corrected = (replace(one, log10_p=min(0.0, one.log10_p + TRIPLE)) for one in named)
    return best_of_each(one for one in corrected if one.log10_p <= log10_fpr)


def best_of_each(named: Iterable[Named]) -> tuple[Named, ...]:
    """Keep the lowest p of everybody, and all frames that show them, the lowest p first."""
    best: dict[str | None, Named] = {}
    for one in named:
        known = best.get(one.recipient, one)
        times = tuple(sorted({*known.times, *one.times}))
        best[one.recipient] = replace(min(known, one, key=lambda n: n.log10_p), times=times)
    return tuple(sorted(best.values(), key=lambda one: one.log10_p))


def best_of_each_scheme(pooled: Iterable[PooledVerdict]) -> tuple[PooledVerdict, ...]:
    """Keep the lowest p of every scheme."""
    best: dict[str, PooledVerdict] = {}
    for one in pooled:
        best[one.scheme] = min(best.get(one.scheme, one), one, key=lambda each: each.log10_p)
    return tuple(best.values())
