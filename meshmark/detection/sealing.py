"""Sealed files: what anybody but the holder of a local secret wrote or altered is refused.

The seal is HMAC-SHA256 [1]_ over every byte of the file. The secret behind it has nothing to do
with keys: what it vouches for is where a measurement was made, whatever key is tried on it.

References
----------
.. [1] H. Krawczyk, M. Bellare, R. Canetti, "HMAC: Keyed-Hashing for Message Authentication",
   RFC 2104, 1997. https://doi.org/10.17487/RFC2104
"""

from __future__ import annotations

import hmac
import os
import re
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

import platformdirs

from meshmark.errors import InputError, OutputError
from meshmark.files.atomic import write_private, written_beside
from meshmark.files.reading import opened, read_small
from meshmark.files.temporary import no_room

SECRET_VARIABLE = "MESHMARK_EVIDENCE_SECRET"
SECRET_BYTES = 32
_HEADER = "meshmark-evidence-secret-1"
_TEXT = re.compile(rf"{_HEADER}\s+([0-9a-f]{{{2 * SECRET_BYTES}}})\s*")

_MOST = 1 << 12  # bytes
_DIGEST = "sha256"
_SEAL_BYTES = 32
# Bytes of a file held at once.
_CHUNK = 1 << 20
# A copy that small stays in memory.
_ROOM = 1 << 22


def secret_path() -> Path:
    """Return where the local secret is, or will be: as the environment says, or by default.

    The default is `evidence.secret` in the user's configuration folder for meshmark.
    """
    named = os.environ.get(SECRET_VARIABLE)
    return Path(named) if named else platformdirs.user_config_path("meshmark") / "evidence.secret"


@contextmanager
def sealed(path: Path, kind: bytes) -> Iterator[Sealing]:
    """Open a file to write to, which is sealed and put in place when the block is left.

    The local secret is made if there is none. What is given can be written to, not sought in.

    Parameters
    ----------
    path : Path
        The file; replaced if it exists.
    kind : bytes
        What the file begins with, and is recognised by.

    Raises
    ------
    OutputError
        If the file or the secret cannot be written; nothing half-written is left.
    InputError
        If the secret cannot be read.
    """
    # The secret first: without it nothing is begun.
    mac = _mac(kind, make=True)
    with written_beside(path) as file, _sealed_into(file, kind, mac) as sealing:
        yield sealing


@contextmanager
def sealed_into(file: IO[bytes], kind: bytes) -> Iterator[Sealing]:
    """Seal what is written in the block into an empty open file; see `sealed`."""
    with _sealed_into(file, kind, _mac(kind, make=True)) as sealing:
        yield sealing


@contextmanager
def _sealed_into(file: IO[bytes], kind: bytes, mac: hmac.HMAC) -> Iterator[Sealing]:
    file.write(kind + bytes(_SEAL_BYTES))
    yield Sealing(file, mac)
    file.seek(len(kind))
    file.write(mac.digest())


def _mac(kind: bytes, *, make: bool = False) -> hmac.HMAC:
    return hmac.new(_secret(make=make), kind, _DIGEST)


class Sealing:
    """A file that can be written to, and whose seal grows with it."""

    def __init__(self, file: IO[bytes], mac: hmac.HMAC) -> None:
        self._file, self._mac = file, mac

    def write(self, data: bytes) -> int:
        """Write the next bytes."""
        self._mac.update(data)
        return self._file.write(data)

    def flush(self) -> None:
        """Leave nothing waiting to be written."""
        self._file.flush()


@contextmanager
def unsealed(path: Path, kind: bytes, *, authenticated: bool = True) -> Iterator[IO[bytes]]:
    """Open what a sealed file holds, once its seal is found whole.

    It is read once, into a temporary file: nobody can exchange it behind the check.

    Parameters
    ----------
    authenticated : bool
        Whether to ask for the seal. Without, anybody may have written what is read.

    Raises
    ------
    InputError
        If the file cannot be read, is of another kind, or its seal is not the secret's.
    OutputError
        If there is no room for temporary files.
    """
    with (
        opened(path) as file,
        unsealed_from(file, kind, path, authenticated=authenticated) as content,
    ):
        yield content


@contextmanager
def unsealed_from(
    file: IO[bytes], kind: bytes, source: object, *, authenticated: bool = True
) -> Iterator[IO[bytes]]:
    """Open what an open sealed file holds; `source` names it. See `unsealed`."""
    with tempfile.SpooledTemporaryFile(max_size=_ROOM) as copy:
        if file.read(len(kind)) != kind:
            raise InputError(
                f"does not begin as {kind.decode().strip()}: it is of an older version, whose "
                "files were not authenticated, or of somebody else's; measure it again",
                source=source,
            )
        mac = _mac(kind) if authenticated else hmac.new(b"", kind, _DIGEST)
        seal = file.read(_SEAL_BYTES)
        while data := file.read(_CHUNK):
            mac.update(data)
            _keep(copy, data)
        if authenticated and not hmac.compare_digest(seal, mac.digest()):
            raise InputError(
                "is not authentic: it was altered, or measured under another secret than that in "
                f"{secret_path()}; measure it again",
                source=source,
            )
        copy.seek(0)
        yield copy


def _keep(copy: IO[bytes], data: bytes) -> None:
    try:
        copy.write(data)
    except OSError as error:
        raise OutputError(no_room(error)) from None


def _secret(*, make: bool = False) -> bytes:
    path = secret_path()
    if make and not path.exists():
        _make_secret(path)
    if not path.exists():
        raise InputError(
            f"there is no secret that evidence could be authentic by; {SECRET_VARIABLE} says "
            "where it is",
            source=path,
        )
    try:
        text = read_small(path, _MOST).decode("ascii")
    except UnicodeDecodeError:
        raise InputError("is not a secret of meshmark's", source=path) from None
    match = _TEXT.fullmatch(text)
    if match is None:
        raise InputError("is not a secret of meshmark's", source=path)
    return bytes.fromhex(match.group(1))


def _make_secret(path: Path) -> None:
    """Write a new secret, readable by its owner only; one that is there by then stays."""
    text = f"{_HEADER}\n{secrets.token_hex(SECRET_BYTES)}\n"
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        with suppress(FileExistsError):
            write_private(text, path)
    except OSError as error:
        raise OutputError(
            f"cannot make the secret that evidence is sealed with: {error.strerror}; "
            f"{SECRET_VARIABLE} says where it is to be",
            source=path,
        ) from None
