"""Verdicts: evidence and a key turned into an answer, with every search paid for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from meshmark.evidence import Evidence
from meshmark.json_values import number
from meshmark.judging import Finding, judge_best
from meshmark.keys import Key
from meshmark.pool import one_thread

Answer = Literal["marked", "not marked", "inconclusive"]


@dataclass(frozen=True)
class PrimVerdict:
    """The answer for one mesh, from the scheme and recipient that fit it best."""

    prim: str
    scheme: str
    verdict: Answer
    log10_p: float
    recipient: str | None
    chips: int
    times: tuple[float, ...]
    finding: Finding

    def as_json(self) -> dict[str, Any]:
        """Return the entry of this mesh in `verify --json`."""
        errors = self.finding.errors
        frames = zip(self.times, self.finding.log10_p_per_frame, errors.per_frame, strict=True)
        return {
            "prim": self.prim,
            "scheme": self.scheme,
            "verdict": self.verdict,
            "log10_p": self.log10_p,
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
        Whose copy, if it is marked and the words of a recipient fit.
    elapsed_s : float
        Seconds spent.
    prims : tuple of PrimVerdict
        Mesh by mesh.
    notes : tuple of str
        What could not be looked at, and why.
    unauthenticated : Verdict or None
        What evidence says that anybody may have written, if there is no other.
    """

    source: str
    verdict: Answer
    log10_p: float
    recipient: str | None
    elapsed_s: float
    prims: tuple[PrimVerdict, ...]
    notes: tuple[str, ...] = ()
    unauthenticated: Verdict | None = None

    def as_json(self) -> dict[str, Any]:
        """Return the entry of this source in `verify --json`."""
        said = self.unauthenticated
        entry = {
            "source": self.source,
            "verdict": self.verdict,
            "log10_p": self.log10_p,
            "recipient": self.recipient,
            "elapsed_s": round(self.elapsed_s, 3),
            "prims": [prim.as_json() for prim in self.prims],
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
    each mesh, meshes for the source; a verdict that may spend a share of the rate, its p over
    that share.
    """
    hypotheses: tuple[str | None, ...] = (None, *recipients)
    price = float(np.log10(n_schemes * len(hypotheses) / share))
    by_prim: dict[str, list[Evidence]] = {}
    for item in evidence:
        by_prim.setdefault(item.prim, []).append(item)
    # Last digits must not depend on whether evidence was measured just now or read from a file.
    with one_thread():
        prims = tuple(
            _decide_prim(items, key, hypotheses, price, float(np.log10(fpr)))
            for items in by_prim.values()
        )
    if not prims:
        return Verdict(source, "inconclusive", 0.0, None, elapsed_s, (), tuple(notes))
    best = min(prims, key=lambda prim: prim.log10_p)
    log10_p = min(0.0, best.log10_p + float(np.log10(len(prims))))
    reachable = min(item.reachable_log10_p for item in evidence) + price + np.log10(len(prims))
    answer = _answer(log10_p, float(reachable), float(np.log10(fpr)))
    recipient = best.recipient if answer == "marked" else None
    return Verdict(source, answer, log10_p, recipient, elapsed_s, prims, tuple(notes))


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


def _decide_prim(
    items: Sequence[Evidence],
    key: Key,
    hypotheses: Sequence[str | None],
    price: float,
    log10_fpr: float,
) -> PrimVerdict:
    found = [(item, judge_best(item, key, hypotheses)) for item in items]
    evidence, finding = min(found, key=lambda pair: pair[1].log10_p)
    log10_p = min(0.0, finding.log10_p + price)
    reachable = min(item.reachable_log10_p for item in items) + price
    return PrimVerdict(
        prim=evidence.prim,
        scheme=evidence.scheme,
        verdict=_answer(log10_p, reachable, log10_fpr),
        log10_p=log10_p,
        recipient=finding.recipient,
        chips=evidence.chips,
        times=tuple(float(t) for t in evidence.times),
        finding=finding,
    )


def _answer(log10_p: float, reachable: float, log10_fpr: float) -> Answer:
    if log10_p <= log10_fpr:
        return "marked"
    return "inconclusive" if reachable > log10_fpr else "not marked"
