"""Checks a ledger whole: its chain, and the time stamps on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cryptography import x509

from meshmark.errors import InputError
from meshmark.ledger.chain import Finding, Link
from meshmark.ledger.store import Ledger
from meshmark.ledger.timestamp import STAMP, read_roots, reverified


@dataclass(frozen=True)
class Stamped:
    """Entries up to one were there at a time, as an authority says."""

    of: int
    time: str


@dataclass(frozen=True)
class Check:
    """What was found.

    Parameters
    ----------
    ledger : str
    entries : int
        How many there should be.
    head : str
        Hash of the last.
    findings : tuple of Finding
        By sequence; none if the ledger is whole.
    stamps : tuple of Stamped
        Those that hold.
    """

    ledger: str
    entries: int
    head: str
    findings: tuple[Finding, ...]
    stamps: tuple[Stamped, ...]

    def as_json(self) -> dict[str, Any]:
        """Return what `ledger verify --json` prints."""
        return {
            "ledger": self.ledger,
            "entries": self.entries,
            "head": self.head,
            "findings": [vars(each) for each in self.findings],
            "timestamps": [vars(each) for each in self.stamps],
        }


def check(ledger: Ledger, root: Path | None = None, noted: str | None = None) -> Check:
    """Check the chain and every time stamp.

    Parameters
    ----------
    root : Path, optional
        Certificates to verify time stamps against, PEM; by default those they were verified
        against when they were recorded.
    noted : str, optional
        Hash of an entry that somebody noted earlier: it must be in the chain. Without it, or a
        time stamp kept elsewhere, whoever may write the whole database can write another history.

    Raises
    ------
    InputError
        If the ledger or the certificates cannot be read.
    """
    roots = None if root is None else read_roots(root)
    sequence, last = ledger.head()
    found = list(ledger.findings())
    broken = {each.sequence for each in found}
    stamps: list[Stamped] = []
    for link in ledger.links(kind=STAMP):
        if link.sequence in broken or link.sequence > sequence or not link.whole:
            continue
        try:
            stamps.append(_restamped(ledger, link, roots))
        except InputError as error:
            found.append(Finding(link.sequence, "timestamp", error.message))
    if noted is not None and not any(link.hash == noted for link in ledger.links()):
        found.append(Finding(sequence, "changed", f"ends a chain that {noted} is not in"))
    order = sorted(found, key=lambda each: each.sequence)
    return Check(ledger.name, sequence, last, tuple(order), tuple(stamps))


def _restamped(ledger: Ledger, link: Link, roots: Sequence[x509.Certificate] | None) -> Stamped:
    entry = link.entry
    stamp = reverified(entry, roots)
    if ledger.link(entry["of"]).hash != stamp.imprint:
        raise InputError(f"holds a time stamp that entry {entry['of']} is not what it was")
    return Stamped(entry["of"], stamp.time)
