"""The chain of entries: each holds the hash of the one before, so that no change goes unseen.

The hash of an entry is the SHA-256 of the hash before, 64 hexadecimal digits, followed by the entry
itself, the bytes of its JSON text. The hash before the first is 64 zeros.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

ORIGIN = "0" * 64
# What the database keeps beside an entry, so that it can be asked for it.
INDEXED = ("kind", "asset", "version", "recipient", "key_id")
# What is told of an entry, rather than recorded.
_TOLD = ("sequence", "recorded_at", "recorded_by")


@dataclass(frozen=True)
class Link:
    """An entry as the database keeps it.

    Parameters
    ----------
    sequence : int
        Its place in the chain, from 1.
    body : str
        The entry, as canonical JSON.
    previous, hash : str
        Hash of the entry before, and of this one.
    indexed : mapping
        What is kept of it beside the body: see `INDEXED` and `record_of`.
    """

    sequence: int
    body: str
    previous: str
    hash: str
    indexed: Mapping[str, Any]

    @classmethod
    def of(cls, entry: Mapping[str, Any], previous: str) -> Link:
        """Append an entry to the chain that ends with a hash."""
        body = canonical(entry)
        return cls(entry["sequence"], body, previous, hash_of(previous, body), indexed_of(entry))

    @property
    def entry(self) -> dict[str, Any]:
        """The entry itself."""
        return json.loads(self.body)

    def as_line(self) -> str:
        """Return what `ledger export` writes: the entry is the very text that was hashed."""
        return f'{{"previous":"{self.previous}","hash":"{self.hash}","entry":{self.body}}}'

    @property
    def whole(self) -> bool:
        """Whether the hash is that of the body."""
        return hash_of(self.previous, self.body) == self.hash

    @property
    def preimage(self) -> bytes:
        """The bytes whose SHA-256 is the entry's hash."""
        return preimage(self.previous, self.body)


@dataclass(frozen=True)
class Finding:
    """Something that is wrong with the chain.

    Parameters
    ----------
    sequence : int
        The entry it is about.
    kind : str
        "changed", "missing", "re-ordered" or "timestamp".
    what : str
        What is wrong, for people.
    """

    sequence: int
    kind: str
    what: str


def canonical(entry: Mapping[str, Any]) -> str:
    """Write an entry as JSON in one way only: names sorted, no blanks, ASCII."""
    return json.dumps(entry, sort_keys=True, separators=(",", ":"), allow_nan=False)


def preimage(previous: str, body: str) -> bytes:
    """Return the bytes whose SHA-256 is the hash of an entry."""
    return (previous + body).encode("utf-8", "surrogateescape")


def hash_of(previous: str, body: str) -> str:
    """Hash an entry with the hash of the one before, 64 hexadecimal digits."""
    return hashlib.sha256(preimage(previous, body)).hexdigest()


def record_of(entry: Mapping[str, Any]) -> str:
    """Name what an entry records, wherever it stands in the chain, 64 hexadecimal digits."""
    recorded = {name: value for name, value in entry.items() if name not in _TOLD}
    return hashlib.sha256(canonical(recorded).encode()).hexdigest()


def indexed_of(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is kept of an entry beside its body."""
    return {name: entry.get(name) for name in INDEXED} | {"record": record_of(entry)}


def findings(links: Iterable[Link], head: tuple[int, str]) -> Iterator[Finding]:
    """Name every entry that was changed, is missing or stands in another place.

    Parameters
    ----------
    links : iterable of Link
        By sequence.
    head : (int, str)
        Sequence and hash of the last entry, as they were kept when it was appended.
    """
    expected = 1
    previous: str | None = ORIGIN
    for link in links:
        if link.sequence > expected:
            yield _missing(expected, link.sequence - 1)
            previous = link.previous
        own = _of_link(link)
        if own is None and previous not in (None, link.previous):
            yield _rewritten(max(1, link.sequence - 1))
        if own is not None:
            yield own
        # The entry after one that is named is not to blame for what comes before it.
        expected, previous = link.sequence + 1, link.hash if own is None else None
    if expected <= head[0]:
        yield _missing(expected, head[0])
    elif previous is not None and (expected - 1, previous) != head:
        yield _rewritten(max(1, expected - 1))


def _missing(first: int, last: int) -> Finding:
    told = "is missing" if first == last else f"and all up to entry {last} are missing"
    return Finding(first, "missing", told)


def _rewritten(sequence: int) -> Finding:
    return Finding(sequence, "changed", "was changed: what follows holds another hash of it")


def _of_link(link: Link) -> Finding | None:
    """Check one entry by itself."""
    if not link.whole:
        return Finding(link.sequence, "changed", "was changed: its hash is another")
    try:
        entry, sequence = link.entry, link.entry["sequence"]
    except (ValueError, LookupError, TypeError):
        return Finding(link.sequence, "changed", "was changed: it is no entry")
    if sequence != link.sequence:
        told = f"stands in another place: it was appended as entry {sequence}"
        return Finding(link.sequence, "re-ordered", told)
    if indexed_of(entry) != link.indexed:
        told = "was changed: what is kept beside it says something else"
        return Finding(link.sequence, "changed", told)
    return None
