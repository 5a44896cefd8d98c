"""Has the end of the chain stamped, by an authority that is asked or whose reply was brought."""

from __future__ import annotations

from pathlib import Path

from meshmark.errors import InputError
from meshmark.files.atomic import write_bytes
from meshmark.ledger.chain import Link
from meshmark.ledger.store import Appended, Ledger
from meshmark.ledger.timestamp import (
    fetched,
    read_reply,
    read_roots,
    request_for,
    stamp_of,
    verified,
)


def write_request(ledger: Ledger, path: Path) -> int:
    """Write a request for a stamp on the last entry, and return its number.

    Raises
    ------
    InputError
        If there is no entry.
    OutputError
        If it cannot be written.
    """
    link = _last(ledger)
    write_bytes(request_for(link).as_bytes(), path)
    return link.sequence


def stamp_by(ledger: Ledger, tsa: str, root: Path) -> Appended:
    """Ask an authority for a stamp on the last entry, and record it once it is verified.

    Raises
    ------
    InputError
        If there is no entry, the authority does not answer, or its reply is not to be trusted.
    OutputError
        If it cannot be recorded.
    """
    roots, link = read_roots(root), _last(ledger)
    request = request_for(link)
    reply = fetched(tsa, request)
    stamp = verified(reply, roots, tsa, request)
    if stamp.imprint != link.hash:
        raise InputError("has stamped something else", source=tsa)
    return ledger.append(stamp_of(link, reply, stamp, roots, tsa))


def stamp_from(ledger: Ledger, path: Path, root: Path) -> Appended:
    """Record a reply that was brought in a file, once it is verified.

    Raises
    ------
    InputError
        If the reply is not to be trusted, or is over no entry of the ledger.
    OutputError
        If it cannot be recorded.
    """
    roots, reply = read_roots(root), read_reply(path)
    stamp = verified(reply, roots, path)
    link = ledger.with_hash(stamp.imprint, path)
    return ledger.append(stamp_of(link, reply, stamp, roots, None))


def _last(ledger: Ledger) -> Link:
    sequence, _ = ledger.head()
    if not sequence:
        raise InputError("holds no entry to be stamped", source=ledger.name)
    return ledger.link(sequence)
