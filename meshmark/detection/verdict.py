"""Verdicts: the answer for a source, mesh by mesh, and how two are joined."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.detection.evidence import InformedFacts
from meshmark.detection.looks import TakenLook
from meshmark.detection.searched import Searched
from meshmark.detection.significance import HypothesisResult
from meshmark.files.atomic import number

# Log10 of what the best of three bounds is corrected by: blind, informed, and both together.
TRIPLE = float(np.log10(3.0))

Answer = Literal["marked", "not marked", "inconclusive"]
# Why no further look was taken at a copy.
End = Literal["marked", "no hope", "all seen"]


@dataclass(frozen=True)
class Named:
    """Somebody whose words are in a copy.

    Parameters
    ----------
    recipient : str or None
        A recipient; None for the owner's own words.
    log10_p : float
        Bound on the probability of that by chance, corrected for every search.
    times : tuple of float
        Time codes of the frames that show it by themselves.
    """

    recipient: str | None
    log10_p: float
    times: tuple[float, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the entry of this name under `recipients` of a mesh."""
        return {
            "recipient": self.recipient,
            "log10_p": self.log10_p,
            "times": [number(time) for time in self.times],
        }


@dataclass(frozen=True)
class InformedVerdict:
    """What a mesh says beside its original.

    Parameters
    ----------
    log10_p : float
        Bound from informed evidence alone, corrected for every search.
    facts : InformedFacts
        How it was laid upon the original.
    """

    log10_p: float
    facts: InformedFacts

    def as_json(self) -> dict[str, Any]:
        """Return the entry `informed` of this mesh."""
        facts = self.facts
        return {
            "log10_p": self.log10_p,
            "prim": facts.prim,
            "method": facts.method,
            "pose": facts.poses[0],
            "poses": list(facts.poses),
            "map": ", ".join(facts.maps),
            "residual": number(facts.residual),
            "covered": number(facts.covered),
            "patches": facts.patches,
        }


@dataclass(frozen=True)
class PrimVerdict:
    """The answer for one mesh, from the part, scheme and recipient that fit it best."""

    prim: str
    scheme: str
    verdict: Answer
    log10_p: float
    recipient: str | None
    chips: int
    times: tuple[float, ...]
    finding: HypothesisResult
    part: str = ""
    also: tuple[str, ...] = ()
    recipients: tuple[Named, ...] = ()
    informed: InformedVerdict | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the entry of this mesh in `verify --json`."""
        errors = self.finding.errors
        frames = zip(self.times, self.finding.log10_p_per_frame, errors.per_frame, strict=True)
        entry = {
            "prim": self.prim,
            "part": self.part,
            "also": list(self.also),
            "scheme": self.scheme,
            "verdict": self.verdict,
            "log10_p": self.log10_p,
            "recipients": [named.as_json() for named in self.recipients],
            "frames": len(self.times),
            "chips": self.chips,
            "ber": {"avg": number(errors.average), "max": number(errors.maximum)},
            "per_frame": [
                {"time": number(time), "log10_p": number(p), "ber": number(ber)}
                for time, p, ber in frames
            ],
        }
        return entry if self.informed is None else {**entry, "informed": self.informed.as_json()}


@dataclass(frozen=True)
class PooledVerdict:
    """What several meshes say together by one scheme.

    Parameters
    ----------
    scheme : str
    meshes : int
        How many, or how many surfaces of meshes.
    log10_p : float
        Bound from their evidence alone, corrected for every search.
    """

    scheme: str
    meshes: int
    log10_p: float

    def as_json(self) -> dict[str, Any]:
        """Return the entry of this scheme under `pooled`."""
        return {"scheme": self.scheme, "meshes": self.meshes, "log10_p": self.log10_p}


@dataclass(frozen=True)
class Verdict:
    """The answer for one source.

    Parameters
    ----------
    source : str
        The file or folder.
    verdict : str
        "marked" if p <= fpr; "inconclusive" if the source holds too few chips for any key to
        get there; otherwise "not marked".
    log10_p : float
        Bound on the probability that a random key does as well, corrected for every search.
    recipient : str or None
        Whose copy, if it is marked and the words of a recipient fit: of several, the one that
        fits best.
    elapsed_s : float
        Seconds spent.
    prims : tuple of PrimVerdict
        Mesh by mesh.
    notes : tuple of str
        What could not be looked at, and why: layers, meshes and frames.
    unauthenticated : Verdict or None
        What evidence says that anybody may have written, if there is no other.
    recipients : tuple of Named
        Everybody whose words are in it, what fits best first; `prims` tell where.
    original : str or None
        What the copy was compared with.
    pooled : tuple of PooledVerdict
        What several meshes say together, one for each scheme that found several.
    looks : tuple of TakenLook
        The looks that were taken at the copy alone, in their order.
    ended : str or None
        Why no further one was: "marked", "no hope" or "all seen".
    hope : float
        `log10_p` before it is limited to 0, and corrected for the share of its look.
    searched : tuple of Searched
        What the bound is corrected for: of the copy alone, and beside its original.
    """

    source: str
    verdict: Answer
    log10_p: float
    recipient: str | None
    elapsed_s: float
    prims: tuple[PrimVerdict, ...]
    notes: tuple[str, ...] = ()
    unauthenticated: Verdict | None = None
    recipients: tuple[Named, ...] = ()
    original: str | None = None
    pooled: tuple[PooledVerdict, ...] = ()
    looks: tuple[TakenLook, ...] = ()
    ended: End | None = None
    hope: float = math.inf
    searched: tuple[Searched, ...] = ()

    @classmethod
    def of_nothing(cls, source: str, notes: Sequence[str] = (), elapsed_s: float = 0.0) -> Verdict:
        """Say of a source that nothing in it was looked at."""
        return cls(source, "inconclusive", 0.0, None, elapsed_s, (), tuple(notes))

    def as_json(self) -> dict[str, Any]:
        """Return the entry of this source in `verify --json`."""
        said = self.unauthenticated
        entry = {
            "source": self.source,
            "verdict": self.verdict,
            "log10_p": self.log10_p,
            "recipient": self.recipient,
            "recipients": [named.recipient for named in self.recipients],
            "elapsed_s": round(self.elapsed_s, 3),
            "prims": [prim.as_json() for prim in self.prims],
            "pooled": [each.as_json() for each in self.pooled],
            "notes": list(self.notes),
        }
        if self.ended is not None:
            entry["looks"] = [look.as_json() for look in self.looks]
            entry["ended"] = self.ended
        if self.original is not None:
            entry["original"] = self.original
        return entry if said is None else {**entry, "unauthenticated": said.as_json()}


def without_weight(verdict: Verdict) -> Verdict:
    """Turn a verdict on evidence that anybody may have written into none."""
    whose = f", copy of {verdict.recipient}" if verdict.recipient else ""
    note = (
        "the evidence is unauthenticated, not for verdicts: "
        f"it says {verdict.verdict}{whose}, log10 p {verdict.log10_p:.2f}"
    )
    notes = (*verdict.notes, note)
    nothing = Verdict.of_nothing(verdict.source, notes, verdict.elapsed_s)
    return replace(nothing, unauthenticated=verdict)


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
