"""Verdicts: the answer for a source, mesh by mesh."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from meshmark.detection.evidence import InformedFacts
from meshmark.detection.looks import TakenLook
from meshmark.detection.searched import Searched
from meshmark.detection.significance import HypothesisResult
from meshmark.files.atomic import number

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
