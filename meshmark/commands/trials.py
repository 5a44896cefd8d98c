"""What `try` answers: for each source of a store, the keys whose mark is in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from meshmark.detection.verdict import Answer, Verdict

UNAUTHENTICATED = "the evidence is unauthenticated, not for verdicts: anybody may have written it"


@dataclass(frozen=True, eq=False)
class Match:
    """A key whose mark is in a source.

    Parameters
    ----------
    key_id : str
    verdict : Verdict
        Corrected for all keys and names.
    """

    key_id: str
    verdict: Verdict

    def as_json(self) -> dict[str, Any]:
        """Return the entry of this key under `matches`."""
        verdict = self.verdict
        return {
            "key_id": self.key_id,
            "log10_p": verdict.log10_p,
            "recipient": verdict.recipient,
            "recipients": [
                {"recipient": one.recipient, "log10_p": one.log10_p} for one in verdict.recipients
            ],
            "prims": [prim.prim for prim in verdict.prims if prim.verdict == "marked"],
        }


@dataclass(frozen=True, eq=False)
class Trial:
    """What all keys and names make of one source.

    Parameters
    ----------
    place : str
        File and row of its evidence.
    source : str
        Where the source was.
    sha256 : str
        Of its bytes.
    verdict : str
        "marked", "not marked" or "inconclusive", as of `verify`.
    log10_p : float or None
        Of the key and name that fit best, corrected for all; None where none came so near that
        it was judged, and p is above the rate.
    matches : tuple of Match
        Keys whose mark is in it, the best first.
    notes : tuple of str
    authenticated : bool
        Whether it is known where it was measured; no verdict rests on other evidence.
    identity : str
        What was measured, and how.
    """

    place: str
    source: str
    sha256: str
    verdict: Answer
    log10_p: float | None
    matches: tuple[Match, ...]
    notes: tuple[str, ...]
    authenticated: bool
    identity: str

    def as_json(self) -> dict[str, Any]:
        """Return the entry of this source in `try --json`."""
        return {
            "source": self.source,
            "sha256": self.sha256,
            "verdict": self.verdict,
            "log10_p": self.log10_p,
            "authenticated": self.authenticated,
            "matches": [match.as_json() for match in self.matches],
            "notes": list(self.notes),
        }

    @property
    def rank(self) -> tuple[bool, float, str]:
        """What is found comes first, then by p."""
        return (not self.matches, 0.0 if self.log10_p is None else self.log10_p, self.source)

    def joined(self, other: Trial) -> Trial:
        """Join it with what further keys make of the same source."""
        told = [p for p in (self.log10_p, other.log10_p) if p is not None]
        matches = sorted((*self.matches, *other.matches), key=lambda one: one.verdict.log10_p)
        marked = self if self.verdict == "marked" else other
        return replace(
            marked, log10_p=min(told, default=None), matches=tuple(matches), notes=self.notes
        )


@dataclass(frozen=True)
class Refusal:
    """Why evidence was not tried.

    Parameters
    ----------
    error : str
        In one line.
    exit_code : int
    """

    error: str
    exit_code: int
