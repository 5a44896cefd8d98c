"""Who signs, and how a file gets its sidecar."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import IO

import c2pa
from cryptography.hazmat.primitives.serialization import Encoding

from meshmark.c2pa.certificates import (
    as_pem,
    belongs,
    key_as_pem,
    read_certificates,
    read_private_key,
)
from meshmark.c2pa.checking import check_content, told
from meshmark.c2pa.sidecar import ANY_FORMAT, OFFLINE, claims
from meshmark.errors import InputError, UsageError
from meshmark.files.reading import opened


@dataclass(frozen=True)
class Signer:
    """A chain of certificates, and the private key of the first.

    Parameters
    ----------
    place : Path
        The file of the certificates, for messages.
    algorithm : str
        As C2PA names it, such as "es256".
    certificate : str
        SHA-256 of the first certificate.
    chain, key : bytes
        PEM; in no message.
    tsa : str or None
        Authority that is asked for a time stamp on each signature.
    """

    place: Path
    algorithm: str
    certificate: str
    chain: bytes = field(repr=False)
    key: bytes = field(repr=False)
    tsa: str | None = None

    @classmethod
    def of(cls, certificates: Path, key: Path, tsa: str | None = None) -> Signer:
        """Read certificates and key, and try whether a file can be signed with them.

        Raises
        ------
        InputError
            If one of them cannot be read, they do not belong together, or C2PA does not allow
            them: they have expired, or are for something else.
        UsageError
            If the authority is no http or https URL.
        """
        if tsa is not None and not tsa.startswith(("http://", "https://")):
            raise UsageError(f"a time-stamping authority has an http or https URL, not {tsa}")
        chain = read_certificates(certificates)
        private, algorithm = read_private_key(key)
        if not belongs(private, chain[0]):
            raise InputError(
                f"is not the key of the first certificate in {certificates}", source=key
            )
        digest = hashlib.sha256(chain[0].public_bytes(Encoding.DER)).hexdigest()
        one = cls(certificates, algorithm, digest, as_pem(chain), key_as_pem(private))
        one._signed(BytesIO(b"a trial"), "a trial", ["a trial"])
        return replace(one, tsa=tsa)

    def sidecar(self, file: Path, record: str, algorithms: Sequence[str]) -> bytes:
        """Sign what `claims` says of a file.

        Raises
        ------
        InputError
            If that cannot be done: the certificate has expired meanwhile, or the authority does
            not answer.
        """
        with opened(file) as content:
            return self._signed(content, record, algorithms)

    def _signed(self, content: IO[bytes], record: str, algorithms: Sequence[str]) -> bytes:
        info = c2pa.C2paSignerInfo(self.algorithm, self.chain, self.key, self.tsa)
        try:
            with (
                closing(c2pa.Context.from_dict({"verify": OFFLINE})) as context,
                closing(c2pa.Builder(claims(record, algorithms), context=context)) as builder,
                closing(c2pa.Signer.from_info(info)) as signer,
            ):
                builder.set_no_embed()
                # What would be written there is the content as it is.
                made: bytes = builder.sign(signer, ANY_FORMAT, content, _Nowhere())
        except c2pa.C2paError as error:
            raise self._refusal(told(error)) from None
        content.seek(0)
        if problems := check_content(content, made).problems:
            raise self._refusal(problems[0])
        return made

    def _refusal(self, reason: str) -> InputError:
        return InputError(f"nothing can be signed with it: {reason}", source=self.place)


class _Nowhere:
    """A file that keeps nothing but its size."""

    def __init__(self) -> None:
        self._place = self._size = 0

    def write(self, data: bytes) -> int:
        self._place += len(data)
        self._size = max(self._size, self._place)
        return len(data)

    def read(self, size: int = -1) -> bytes:
        raise OSError("nothing was kept")

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        self._place = offset + {os.SEEK_SET: 0, os.SEEK_CUR: self._place}.get(whence, self._size)
        return self._place

    def tell(self) -> int:
        return self._place

    def flush(self) -> None:
        pass
