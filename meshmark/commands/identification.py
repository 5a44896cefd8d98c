"""What `identify` is asked of every suspect, and answers: the candidates, the best first."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from meshmark.detection.verdict import Answer, Verdict
from meshmark.errors import MeshmarkError, UsageError
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key, keys_in
from meshmark.ledger.chain import canonical
from meshmark.ledger.origins import Origin
from meshmark.sources.readers import files_named


@dataclass(frozen=True, eq=False)
class Request:
    """What is asked of every suspect.

    It can be pickled and sent anywhere: of the keys it knows the folder, and the ids.

    Parameters
    ----------
    origins : sequence of Origin
        All that the ledger knows.
    key_folder : Path
        Read where a suspect is identified.
    key_ids : sequence of str
        Of the keys that are to be in it.
    fpr, most, everything
        As of `meshmark.commands.identify.identify`.
    trusted : bool
        Read suspects in this process.
    jobs : int
        Processes that the frames of one suspect are shared among.
    recorded : bool
        Whether outcomes tell the hashes of what was read, and what was asked.
    timeout : float, optional
        Seconds that one suspect may take.
    ledger : mapping, optional
        Where that is recorded, what of the ledger the answer depends on; see `ledger_facts`.
    """

    origins: Sequence[Origin]
    key_folder: Path
    key_ids: Sequence[str]
    fpr: float = 1e-6
    most: int = 8
    everything: bool = False
    trusted: bool = False
    jobs: int = 1
    recorded: bool = False
    timeout: float | None = None
    ledger: Mapping[str, Any] = field(default_factory=dict)

    @property
    def paths(self) -> Sequence[str | Path | None]:
        """What else is read for every suspect; an original that is not found is told of."""
        return (self.key_folder,)

    def asked(self, source: str) -> dict[str, Any]:
        """Tell all that the answer for a suspect depends on, beside its files."""
        return {
            "ledger": dict(self.ledger),
            "key_ids": list(self.key_ids),
            "fpr": self.fpr,
            "most": self.most,
            "all": self.everything,
        }

    def keys(self) -> dict[str, Key]:
        """Read the keys, by id.

        Raises
        ------
        UsageError
            If one of them is not there.
        """
        found = keys_in(self.key_folder)
        missing = [key_id for key_id in self.key_ids if key_id not in found]
        if missing:
            raise UsageError(f"does not hold the key {missing[0]} here", source=self.key_folder)
        return {key_id: found[key_id] for key_id in self.key_ids}


def ledger_facts(origins: Sequence[Origin]) -> dict[str, Any]:
    """Tell what of a ledger an answer depends on: copies, layers as they are here, originals.

    Parameters
    ----------
    origins : sequence of Origin
    """
    digest = hashlib.sha256()
    for origin in origins:
        digest.update(canonical({**_told(origin), "here": _layers_here(origin)}).encode())
    return {
        "copies": sum(len(origin.copies) for origin in origins),
        "sha256": digest.hexdigest(),
        "originals": sum(_is_there(origin.source) for origin in origins),
    }


def _told(origin: Origin) -> dict[str, Any]:
    return {**asdict(origin), "source": str(origin.source)}


def _layers_here(origin: Origin) -> list[dict[str, Any]] | str:
    """Tell the versions that read it, or why nothing does."""
    try:
        return [recipe.as_json() for recipe in layers_of(origin)]
    except MeshmarkError as error:
        return error.message


def _is_there(source: Path) -> bool:
    return any(path.exists() for path in files_named(str(source)))


def layers_of(origin: Origin) -> list[Recipe]:
    """Build the layers of an origin from what its manifest tells."""
    segmenter, geodesic = origin.plugins["segmenter"], origin.plugins["geodesic"]
    return [
        Recipe(
            layer["name"],
            segmenter["name"],
            geodesic["name"],
            {each["name"]: each["parameters"] for each in (layer, segmenter, geodesic)},
        )
        for layer in origin.layers
    ]


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
