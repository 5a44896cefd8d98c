"""What a file's C2PA sidecar says, and whether manifest and ledger agree."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshmark.c2pa.checking import Credentials, check_file
from meshmark.c2pa.sidecar import algorithm_of
from meshmark.embedding.manifest import own_manifest
from meshmark.ledger.marks import MARK

TRUSTED, UNKNOWN, INVALID = "trusted", "unknown signer", "invalid"


@dataclass(frozen=True)
class Answer:
    """What was found.

    Parameters
    ----------
    file, sidecar : str
    verdict : str
        "trusted", "invalid", or "unknown signer" where all is whole but nobody was said to be
        trusted.
    credentials : Credentials
    problems : tuple of str
        What is wrong with the sidecar, then what manifest and ledger know otherwise.
    manifest : bool
        Whether there is a manifest of the file with a record, which was compared.
    entries : tuple of int or None
        Entries of the ledger with the record; None if no ledger was asked.
    """

    file: str
    sidecar: str
    verdict: str
    credentials: Credentials
    problems: tuple[str, ...]
    manifest: bool
    entries: tuple[int, ...] | None

    def as_json(self) -> dict[str, Any]:
        """Return what `c2pa verify --json` prints."""
        found = self.credentials
        return {
            "file": self.file,
            "sidecar": self.sidecar,
            "verdict": self.verdict,
            "signer": found.signer,
            "issuer": found.issuer,
            "trusted": found.trusted,
            "stamped": found.stamped,
            "bindings": [{"alg": name, "value": value} for name, value in found.bindings],
            "manifest": self.manifest,
            "entries": None if self.entries is None else list(self.entries),
            "problems": list(self.problems),
        }


def verify_credentials(
    file: Path,
    sidecar: Path,
    *,
    anchors: Path | None = None,
    entries: Iterable[Mapping[str, Any]] | None = None,
) -> Answer:
    """Check a sidecar, and its record against the manifest beside the file and a ledger.

    Parameters
    ----------
    anchors : Path, optional
        Certificates that are trusted, PEM.
    entries : iterable of mapping, optional
        Of a ledger.

    Raises
    ------
    InputError
        If a file cannot be read, or the sidecar is none.
    """
    found = check_file(file, sidecar, anchors)
    problems = [*found.problems]
    if anchors is not None and not found.trusted and not problems:
        problems.append(f"no certificate in {anchors} is one that the signer's lead to")
    expected = _expected(own_manifest(file))
    if expected is not None and list(found.bindings) != expected:
        problems.append("the manifest beside it tells of another record, or of other schemes")
    if not found.records:
        problems.append("it names no record")
    numbers = None if entries is None else tuple(_entries_of(found.records, entries))
    if numbers == ():
        problems.append("no entry of the ledger has its record")
    verdict = INVALID if problems else TRUSTED if found.trusted else UNKNOWN
    return Answer(
        str(file), str(sidecar), verdict, found, tuple(problems), expected is not None, numbers
    )


def _expected(manifest: dict[str, Any] | None) -> list[tuple[str, str]] | None:
    """List the soft bindings that a manifest tells of; None if it tells of none."""
    try:
        record, layers = (manifest or {})["record"], (manifest or {})["layers"]
        return [(algorithm_of(each), str(record)) for each in layers]
    except (KeyError, TypeError):
        # Whoever sent the file may have written the manifest.
        return None


def _entries_of(records: tuple[str, ...], entries: Iterable[Mapping[str, Any]]) -> Iterable[int]:
    for entry in entries:
        if entry["kind"] == MARK and entry["manifest"].get("record") in records:
            yield entry["sequence"]
