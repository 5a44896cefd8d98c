"""Verdicts: evidence and a key turned into an answer, with every search paid for."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.detection.evidence import Evidence
from meshmark.detection.hypothesis_test import HypothesisResult, judge_each
from meshmark.files.atomic import number
from meshmark.keys import Key
from meshmark.workers.pool import one_thread

Answer = Literal["marked", "not marked", "inconclusive"]

# Stands for no share at all, where a logarithm is taken.
TINY = 1e-300


@dataclass(frozen=True)
class Named:
    """Somebody whose words are in a copy.

    Parameters
    ----------
    recipient : str or None
        A recipient; None for the owner's own words.
    log10_p : float
        Bound on the probability of that by chance, all searches paid for.
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

    def as_json(self) -> dict[str, Any]:
        """Return the entry of this mesh in `verify --json`."""
        errors = self.finding.errors
        frames = zip(self.times, self.finding.log10_p_per_frame, errors.per_frame, strict=True)
        return {
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
        Bound on the probability that a random key does as well, all searches paid for.
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
            "notes": list(self.notes),
        }
        return entry if said is None else {**entry, "unauthenticated": said.as_json()}


def decide(
    source: str,
    evidence: Sequence[Evidence],
    key: Key,
    *,
    recipients: Sequence[str] = (),
    fpr: float = 1e-6,
    n_schemes: int = 1,
    share: float = 1.0,
    elapsed_s: float = 0.0,
    notes: Sequence[str] = (),
) -> Verdict:
    """Answer for a source from the evidence of its meshes.

    Parameters
    ----------
    evidence : sequence of Evidence
        One for each mesh and scheme that could be measured.
    recipients : sequence of str
        Recipients to try beside the owner's own words.
    fpr : float
        Largest p that still counts as marked.
    n_schemes : int
        Number of schemes tried; each mesh pays for them.
    share : float
        Share of the false-positive rate that this verdict may spend, where several are asked
        for: the shares of all must sum to at most 1.

    Notes
    -----
    The best of n hypotheses is worth n times its p (union bound): schemes and recipients for
    each mesh; a verdict that may spend a share of the rate, its p over that share. Meshes and
    parts of meshes share what a scheme may spend by what they could show, see `shares`: a part
    with the share w is worth its p over w.
    """
    hypotheses: tuple[str | None, ...] = (None, *recipients)
    price = float(np.log10(n_schemes * len(hypotheses) / share))
    log10_fpr = float(np.log10(fpr))
    prices = price - shares(evidence)
    # Last digits must not depend on whether evidence was measured just now or read from a file.
    with one_thread():
        judged = [
            _Judged.of(item, key, hypotheses, float(own), log10_fpr)
            for item, own in zip(evidence, prices, strict=True)
        ]
    if not judged:
        return Verdict(source, "inconclusive", 0.0, None, elapsed_s, (), tuple(notes))
    by_prim: dict[str, list[_Judged]] = {}
    for one in judged:
        for prim in (one.evidence.prim, *one.evidence.also):
            by_prim.setdefault(prim, []).append(one)
    prims = tuple(_prim_verdict(prim, ones, log10_fpr) for prim, ones in by_prim.items())
    best = min(judged, key=lambda one: one.log10_p)
    answer = _answer(best.log10_p, min(one.reachable for one in judged), log10_fpr)
    found = _best_of_each(named for one in judged for named in one.named)
    return Verdict(
        source=source,
        verdict=answer,
        log10_p=best.log10_p,
        recipient=best.findings[0].recipient if answer == "marked" else None,
        elapsed_s=elapsed_s,
        prims=prims,
        notes=tuple(notes),
        recipients=found,
    )


def without_weight(verdict: Verdict) -> Verdict:
    """Turn a verdict on evidence that anybody may have written into none."""
    whose = f", copy of {verdict.recipient}" if verdict.recipient else ""
    note = (
        "the evidence is unauthenticated, not for verdicts: "
        f"it says {verdict.verdict}{whose}, log10 p {verdict.log10_p:.2f}"
    )
    notes = (*verdict.notes, note)
    nothing = Verdict(verdict.source, "inconclusive", 0.0, None, verdict.elapsed_s, (), notes)
    return replace(nothing, unauthenticated=verdict)


def together(one: Verdict, two: Verdict) -> Verdict:
    """Join two verdicts on one source that share a false-positive rate: the lower p of each."""
    best = min(one, two, key=lambda verdict: verdict.log10_p)
    by_prim: dict[str, PrimVerdict] = {}
    for prim in (*one.prims, *two.prims):
        known = by_prim.get(prim.prim, prim)
        by_prim[prim.prim] = replace(
            min(known, prim, key=lambda own: own.log10_p),
            recipients=_best_of_each((*known.recipients, *prim.recipients)),
        )
    recipients = _best_of_each((*one.recipients, *two.recipients))
    return replace(best, prims=tuple(by_prim.values()), recipients=recipients)


def shares(evidence: Sequence[Evidence]) -> FloatArray:
    """Share a scheme's rate among the meshes and parts it was tried on, (n,), in log10.

    By the square of what each could reach at best, in decades: no key is needed to tell that,
    and hundreds of cubes that hold no chips beside a body then cost it nothing.
    """
    reach = np.array([item.reachable_log10_p for item in evidence]) ** 2
    schemes = np.array([item.scheme for item in evidence])
    total = np.array([reach[schemes == scheme].sum() for scheme in schemes])
    count = np.array([np.sum(schemes == scheme) for scheme in schemes])
    share = np.where(total > 0.0, reach / np.maximum(total, TINY), 1.0 / np.maximum(count, 1))
    return np.log10(np.maximum(share, TINY))


@dataclass(frozen=True, eq=False)
class _Judged:
    """What a key makes of one mesh, or part of one, by one scheme; all is paid for."""

    evidence: Evidence
    findings: Sequence[HypothesisResult]
    price: float
    log10_fpr: float

    @classmethod
    def of(
        cls,
        evidence: Evidence,
        key: Key,
        hypotheses: Sequence[str | None],
        price: float,
        log10_fpr: float,
    ) -> _Judged:
        """Try a key and every recipient; where nothing is held, nothing fits."""
        if not evidence.held.any():
            return cls(
                evidence, [HypothesisResult.of_nothing(len(evidence.times))], price, log10_fpr
            )
        findings = judge_each(evidence, key, hypotheses, log10_fpr - price)
        return cls(evidence, findings, price, log10_fpr)

    def paid(self, log10_p: float) -> float:
        """Pay for what was searched."""
        return min(0.0, log10_p + self.price)

    @property
    def log10_p(self) -> float:
        """Bound for what fits best."""
        return self.paid(self.findings[0].log10_p)

    @property
    def reachable(self) -> float:
        """Lowest bound that the best of keys could reach."""
        return self.evidence.reachable_log10_p + self.price

    @property
    def named(self) -> Iterator[Named]:
        """Everybody whose words are in it."""
        for finding in self.findings:
            log10_p = self.paid(finding.log10_p)
            if log10_p <= self.log10_fpr:
                alone = finding.log10_p_per_frame + self.price <= self.log10_fpr
                times = self.evidence.times[alone]
                yield Named(finding.recipient, log10_p, tuple(times.tolist()))


def _prim_verdict(prim: str, judged: Sequence[_Judged], log10_fpr: float) -> PrimVerdict:
    best = min(judged, key=lambda one: one.log10_p)
    evidence, finding = best.evidence, best.findings[0]
    others = tuple(name for name in (evidence.prim, *evidence.also) if name != prim)
    return PrimVerdict(
        prim=prim,
        scheme=evidence.scheme,
        verdict=_answer(best.log10_p, min(one.reachable for one in judged), log10_fpr),
        log10_p=best.log10_p,
        recipient=finding.recipient,
        chips=evidence.chips,
        times=tuple(float(t) for t in evidence.times),
        finding=finding,
        part=evidence.part,
        also=others,
        recipients=_best_of_each(named for one in judged for named in one.named),
    )


def _best_of_each(named: Iterable[Named]) -> tuple[Named, ...]:
    """Keep the lowest p of everybody, and all frames that show them, the lowest p first."""
    best: dict[str | None, Named] = {}
    for one in named:
        known = best.get(one.recipient, one)
        times = tuple(sorted({*known.times, *one.times}))
        best[one.recipient] = replace(min(known, one, key=lambda n: n.log10_p), times=times)
    return tuple(sorted(best.values(), key=lambda one: one.log10_p))


def _answer(log10_p: float, reachable: float, log10_fpr: float) -> Answer:
    if log10_p <= log10_fpr:
        return "marked"
    return "inconclusive" if reachable > log10_fpr else "not marked"
