"""Time stamps on the chain: what a third party says was there, and when (RFC 3161).

A stamp is over the hash of one entry, and so over all before it. It is kept in the ledger as an
entry of its own, with the roots that it was verified against.
"""

from __future__ import annotations

import base64
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from http.client import HTTPException
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from rfc3161_client import (
    HashAlgorithm,
    TimeStampRequest,
    TimestampRequestBuilder,
    VerificationError,
    VerifierBuilder,
    decode_timestamp_response,
)

from meshmark.errors import InputError
from meshmark.files.reading import read_small
from meshmark.ledger.chain import Link

STAMP = "timestamp"
# Bytes of a reply or a file of certificates, and seconds that an authority has to answer.
LONGEST, PATIENCE = 1 << 20, 30
SHA256 = x509.ObjectIdentifier("2.16.840.1.101.3.4.2.1")


@dataclass(frozen=True)
class Stamp:
    """A verified time stamp.

    Parameters
    ----------
    imprint : str
        The hash that was stamped, 64 hexadecimal digits.
    time : str
        When, as the authority says; ISO 8601, UTC.
    """

    imprint: str
    time: str


def request_for(link: Link) -> TimeStampRequest:
    """Ask for a stamp on an entry: its imprint is the entry's hash."""
    return TimestampRequestBuilder(link.preimage, HashAlgorithm.SHA256).build()


def fetched(url: str, request: TimeStampRequest) -> bytes:
    """Send a request to an authority, and return its reply, DER.

    Raises
    ------
    InputError
        If it cannot be reached, or does not answer with a reply.
    """
    if not url.startswith(("http://", "https://")):
        raise InputError("the URL of a time-stamping authority begins with http", source=url)
    headers = {"Content-Type": "application/timestamp-query"}
    try:
        asked = urllib.request.Request(url, request.as_bytes(), headers)
        with urllib.request.urlopen(asked, timeout=PATIENCE) as answer:
            reply = answer.read(LONGEST + 1)
    except urllib.error.URLError as error:
        raise InputError(f"does not answer: {error.reason}", source=url) from None
    except (OSError, HTTPException, ValueError) as error:
        raise InputError(f"does not answer: {error}", source=url) from None
    if len(reply) > LONGEST:
        raise InputError("answers with too much", source=url)
    return bytes(reply)


def read_roots(path: Path) -> list[x509.Certificate]:
    """Read certificates to trust, PEM.

    Raises
    ------
    InputError
        If the file cannot be read, or holds none.
    """
    try:
        return x509.load_pem_x509_certificates(read_small(path, LONGEST))
    except ValueError:
        raise InputError("holds no certificates in PEM", source=path) from None


def read_reply(path: Path) -> bytes:
    """Read an authority's reply from a file, DER.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    return read_small(path, LONGEST)


def verified(
    reply: bytes,
    roots: Sequence[x509.Certificate],
    source: object,
    request: TimeStampRequest | None = None,
) -> Stamp:
    """Verify a reply offline.

    Parameters
    ----------
    reply : bytes
        DER, and nothing after it.
    roots : sequence of Certificate
        Those that are trusted; all other certificates must be in the reply.
    source : object
        Where it is from, for messages.
    request : TimeStampRequest, optional
        What it must answer.

    Raises
    ------
    InputError
        If it is no reply, not signed by who is trusted, or answers something else.
    """
    try:
        response = decode_timestamp_response(reply)
        told = response.tst_info.message_imprint
        if told.hash_algorithm != SHA256:
            raise ValueError("the imprint is no SHA-256")
        imprint = bytes(told.message)
        builder = VerifierBuilder() if request is None else VerifierBuilder.from_request(request)
        for root in roots:
            builder = builder.add_root_certificate(root)
        builder.build().verify(response, imprint)
    except (VerificationError, ValueError) as error:
        raise InputError(f"is no time stamp to be trusted: {error}", source=source) from None
    return Stamp(imprint.hex(), response.tst_info.gen_time.isoformat())


def stamp_of(
    link: Link, reply: bytes, stamp: Stamp, roots: Sequence[x509.Certificate], tsa: str | None
) -> dict[str, Any]:
    """Tell of a stamp on an entry, as the ledger records it."""
    return {
        "kind": STAMP,
        "of": link.sequence,
        "hash": link.hash,
        "time": stamp.time,
        "tsa": tsa,
        "reply": base64.b64encode(reply).decode(),
        "roots": [root.public_bytes(Encoding.PEM).decode() for root in roots],
    }


def reverified(entry: Mapping[str, Any], roots: Sequence[x509.Certificate] | None = None) -> Stamp:
    """Verify a stamp of the ledger again; against the roots it was verified against, or others.

    Raises
    ------
    InputError
        If it is not to be trusted, or is over something else than the entry says.
    """
    where = f"entry {entry['sequence']}"
    if roots is None:
        roots = x509.load_pem_x509_certificates("".join(entry["roots"]).encode())
    stamp = verified(base64.b64decode(entry["reply"]), roots, where)
    if stamp.imprint != entry["hash"]:
        raise InputError("the time stamp is over another hash", source=where)
    return stamp
