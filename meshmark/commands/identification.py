"""What `identify` answers: the candidates for a suspect, the best first."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from meshmark.detection.verdict import Answer, Verdict
from meshmark.ledger.origins import Origin


@dataclass(frozen=True, eq=False)
class Candidate:
    """What a suspect says of one origin, or alone of one key.

    Parameters
    ----------
    key_id : str
    verdict : Verdict
        Corrected for all hypotheses.
    origin : Origin or None
        None where the suspect was looked at alone.
    informed : Verdict or None
        What it says beside the original alone, corrected like the verdict.
    why : str
        Why it was not laid upon the original; empty if it was.
    """

    key_id: str
    verdict: Verdict
    origin: Origin | None = None
    informed: Verdict | None = None
    why: str = ""

    @property
    def by_mark(self) -> bool:
        """Whether the mark that is read beside the original tells that it is this one."""
        return self.informed is not None and self.informed.verdict == "marked"

    @property
    def by_shape(self) -> bool:
        """Whether the suspect lies on the original."""
        return self.informed is not None and bool(self.informed.prims)

    def as_json(self) -> dict[str, Any]:
        """Return its entry in `identify --json`."""
        origin, verdict = self.origin, self.verdict
        whose = verdict.recipient if verdict.verdict == "marked" else None
        return {
            "asset": None if origin is None else origin.asset,
            "version": None if origin is None else origin.version,
            "key_id": self.key_id,
            "verdict": verdict.verdict,
            "log10_p": verdict.log10_p,
            "informed_log10_p": None if self.informed is None else self.informed.log10_p,
            "recipients": [named.recipient for named in verdict.recipients],
            "entries": [] if origin is None else origin.entries_for(whose),
            "original": None if origin is None else str(origin.source),
            "placed": self.by_shape,
            "why": self.why,
        }


@dataclass(frozen=True, eq=False)
class Identification:
    """The answer for one suspect.

    Parameters
    ----------
    source : str
    verdict : str
        "marked", "not marked" or "inconclusive", as of `verify`.
    candidates : tuple of Candidate
        The best first.
    hypotheses : int
        Words that were paid for: of all keys and names, alone and beside every original.
    notes : tuple of str
    elapsed_s : float
    """

    source: str
    verdict: Answer
    candidates: tuple[Candidate, ...]
    hypotheses: int
    notes: tuple[str, ...]
    elapsed_s: float

    @property
    def best(self) -> Candidate | None:
        """The candidate that the answer rests on."""
        return self.candidates[0] if self.candidates else None

    @property
    def log10_p(self) -> float:
        """Bound on the probability of the best candidate by chance, corrected for all."""
        return 0.0 if self.best is None else self.best.verdict.log10_p

    def as_json(self) -> dict[str, Any]:
        """Return the entry of this suspect in `identify --json`."""
        best = self.best if self.verdict == "marked" else None
        said = None if best is None else best.as_json()
        return {
            "source": self.source,
            "verdict": self.verdict,
            "log10_p": self.log10_p,
            "hypotheses": self.hypotheses,
            "asset": said and said["asset"],
            "version": said and said["version"],
            "told_by": _told_by(best),
            "recipient": None if best is None else best.verdict.recipient,
            "key_id": None if best is None else best.key_id,
            "entries": said["entries"] if said else [],
            "candidates": [each.as_json() for each in self.candidates],
            "notes": list(self.notes),
            "elapsed_s": round(self.elapsed_s, 3),
        }


def _told_by(best: Candidate | None) -> str | None:
    if best is None or best.origin is None or not best.by_shape:
        return None
    return "mark" if best.by_mark else "shape"
