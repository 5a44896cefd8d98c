"""Checks a sidecar by itself, and against the file that it is beside; offline."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import c2pa

from meshmark.c2pa.certificates import as_pem, read_certificates
from meshmark.c2pa.sidecar import ANY_FORMAT, BINDING, OFFLINE
from meshmark.errors import InputError
from meshmark.files.reading import opened, read_small

# Bytes of a sidecar.
LARGEST = 1 << 26
UNTRUSTED = "signingCredential.untrusted"
# What must be said to be right, and what is often wrong, the gravest first.
NEEDED = ("assertion.dataHash.match", "claimSignature.validated")
PLAIN = {
    "assertion.dataHash.mismatch": "this is not the file that was signed",
    "claimSignature.mismatch": "the signature is another's, or over something else",
    "assertion.hashedURI.mismatch": "what it says was changed after it was signed",
    "signingCredential.expired": "the certificate has expired, and no trusted time stamp is older",
}


@dataclass(frozen=True)
class Credentials:
    """What a sidecar says of a file, and whether it can.

    Parameters
    ----------
    problems : tuple of str
        What is wrong, the gravest first; none if the sidecar is whole, signed while its
        certificate was valid, and about this file.
    trusted : bool
        Whether the certificates lead to one that is trusted.
    signer, issuer : str or None
        Names in the certificate; whoever made it chose them.
    stamped : str or None
        When an authority saw the signature.
    bindings : tuple of (str, str)
        Algorithm and value of each soft binding.
    """

    problems: tuple[str, ...]
    trusted: bool
    signer: str | None = None
    issuer: str | None = None
    stamped: str | None = None
    bindings: tuple[tuple[str, str], ...] = ()

    @property
    def records(self) -> tuple[str, ...]:
        """Values of the soft bindings, each once."""
        return tuple(dict.fromkeys(value for _, value in self.bindings))


def check_file(file: Path, sidecar: Path, anchors: Path | None = None) -> Credentials:
    """Check the sidecar of a file.

    Parameters
    ----------
    anchors : Path, optional
        Certificates that are trusted, PEM: roots of signers, and of time-stamping authorities.
        Without it, nobody is.

    Raises
    ------
    InputError
        If a file cannot be read, or the sidecar is none.
    """
    trusted = None if anchors is None else as_pem(read_certificates(anchors)).decode()
    said = read_small(sidecar, LARGEST)
    with opened(file) as content:
        try:
            return check_content(content, said, trusted)
        except c2pa.C2paError as error:
            reason = f"is no sidecar that can be read: {told(error)}"
            raise InputError(reason, source=sidecar) from None


def check_content(content: IO[bytes], sidecar: bytes, anchors: str | None = None) -> Credentials:
    """Check a sidecar against the content of a file; see `check_file`.

    Raises
    ------
    c2pa.C2paError
        If the sidecar is none.
    """
    settings: dict[str, Any] = {"verify": OFFLINE}
    if anchors is not None:
        settings["trust"] = {"trust_anchors": anchors}
    with (
        closing(c2pa.Context.from_dict(settings)) as context,
        closing(c2pa.Reader(ANY_FORMAT, content, sidecar, context=context)) as reader,
    ):
        said = _parsed(reader.json())
    valid = said.get("validation_state") in ("Valid", "Trusted")
    results = (said.get("validation_results") or {}).get("activeManifest") or {}
    manifest = said["manifests"].get(said.get("active_manifest")) or {}
    failures = {each["code"]: each.get("explanation") for each in results.get("failure", [])}
    passed = {each["code"] for each in results.get("success", [])}
    untrusted = UNTRUSTED in failures
    failures.pop(UNTRUSTED, None)
    if not failures and not (valid and passed.issuperset(NEEDED)):
        failures["incomplete"] = "the sidecar does not say what it must"
    order = sorted(failures, key=lambda code: [*PLAIN, code].index(code))
    signature = manifest.get("signature_info") or {}
    return Credentials(
        problems=tuple(PLAIN.get(code) or f"{failures[code]} ({code})" for code in order),
        trusted=not untrusted and "signingCredential.trusted" in passed,
        signer=signature.get("common_name"),
        issuer=signature.get("issuer"),
        stamped=signature.get("time") if "timeStamp.trusted" in passed else None,
        bindings=tuple(_bindings(manifest)),
    )


def told(error: c2pa.C2paError) -> str:
    """Say in one line what the library complains about."""
    return " ".join(str(error).split()) or type(error).__name__


def _parsed(text: str) -> dict[str, Any]:
    try:
        said: dict[str, Any] = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise c2pa.C2paError(f"what it holds cannot be told: {error}") from None
    return said


def _bindings(manifest: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """List algorithm and value of each soft binding; whoever signed may have written anything."""
    for assertion in manifest.get("assertions") or []:
        data = assertion.get("data")
        if str(assertion.get("label")).partition("__")[0] != BINDING or not isinstance(data, dict):
            continue
        for block in data.get("blocks") or []:
            if isinstance(block, dict):
                yield str(data.get("alg")), str(block.get("value"))
