"""Secret keys: key files, derivation, code words. A key itself is never printed, only its id."""

from __future__ import annotations

import hmac
import os
import re
import secrets
import stat
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.kdf.hkdf import HKDFExpand
from numpy.typing import NDArray

from meshmark.errors import InputError, OutputError
from meshmark.files.atomic import write_private
from meshmark.files.reading import read_small
from meshmark.hashing.hmac_sha256 import DIGEST_BYTES, codes

KEY_BYTES = 32
KEY_SUFFIX = ".key"
_HEADER = "meshmark-key-1"
_TEXT = re.compile(rf"{_HEADER}\s+([0-9a-f]{{{2 * KEY_BYTES}}})\s*")
# Whoever edits a key file may leave blanks in it, but no more than that.
_MOST = 1 << 12  # bytes
# HKDF-SHA256 yields at most 255 blocks.
_HKDF_LIMIT = 255 * DIGEST_BYTES
# What all labels begin with.
_CONTEXT = "meshmark/1/"


@dataclass(frozen=True, repr=False)
class Key:
    """A 256-bit secret.

    Everything pseudo-random is derived from it by HKDF-SHA256 [1]_ under a label, so that
    uses are independent of each other and equal on every platform and version.

    Parameters
    ----------
    secret : bytes
        32 random bytes.

    References
    ----------
    .. [1] H. Krawczyk, P. Eronen, "HMAC-based Extract-and-Expand Key Derivation Function
       (HKDF)", RFC 5869, 2010. https://doi.org/10.17487/RFC5869
    """

    secret: bytes

    def __post_init__(self) -> None:
        if len(self.secret) != KEY_BYTES:
            raise InputError(f"a key has {KEY_BYTES} bytes, this one {len(self.secret)}")

    def __repr__(self) -> str:
        return f"Key(id={self.id!r})"

    @classmethod
    def generate(cls) -> Key:
        """Draw a key from the operating system's entropy."""
        return cls(secrets.token_bytes(KEY_BYTES))

    @property
    def id(self) -> str:
        """A one-way fingerprint, 16 hexadecimal digits: safe to print and to store."""
        return self.derive("key id", 8).hex()

    def derive(self, label: str, n_bytes: int) -> bytes:
        """Derive `n_bytes` pseudo-random bytes under a label."""
        if n_bytes > _HKDF_LIMIT:
            raise ValueError(f"at most {_HKDF_LIMIT} bytes can be derived under one label")
        return self._expanded(f"{_CONTEXT}{label}".encode(), n_bytes)

    def _expanded(self, label: bytes, n_bytes: int) -> bytes:
        return HKDFExpand(hashes.SHA256(), n_bytes, label).derive(self._extracted)

    @cached_property
    def _extracted(self) -> bytes:
        """HKDF's first step, which all labels share: without salt, HMAC under a key of zeros."""
        return hmac.digest(bytes(32), self.secret, "sha256")

    def words(
        self, scheme: str, n_words: int, n_chips: int, recipient: str | None = None
    ) -> NDArray[np.int64]:
        """Derive the code words of a scheme.

        Parameters
        ----------
        scheme : str
            Name of the scheme: two schemes never share words.
        n_words, n_chips : int
            How many words, and how many chips each.
        recipient : str, optional
            Whose copy: every recipient has words of its own; None is the owner's own copy.

        Returns
        -------
        (n_words, n_chips) int
            Independent uniform signs, +1 or -1, bits taken most significant first.
        """
        return self.words_of(scheme, n_words, n_chips, (recipient,))[0].astype(np.int64)

    def words_of(
        self, scheme: str, n_words: int, n_chips: int, recipients: Sequence[str | None]
    ) -> NDArray[np.int8]:
        """Derive the code words of many recipients, (n, n_words, n_chips); see `words`."""
        return words_of_keys((self,), scheme, range(n_words), n_chips, recipients)[0]

    def generator(self, label: str) -> np.random.Generator:
        """Seed a numpy generator by the key, for choices that detection need not repeat."""
        return np.random.Generator(
            np.random.PCG64(int.from_bytes(self.derive(f"generator/{label}", 16), "big"))
        )

    def save(self, path: Path) -> None:
        """Write a key file, readable by its owner only.

        Raises
        ------
        OutputError
            If the file exists (a key is never overwritten) or cannot be written.
        """
        try:
            write_private(f"{_HEADER}\n{self.secret.hex()}\n", path)
        except FileExistsError:
            raise OutputError("exists already; a key is never overwritten", source=path) from None
        except OSError as error:
            raise OutputError(f"cannot write the key file: {error.strerror}", source=path) from None

    @classmethod
    def load(cls, path: Path) -> Key:
        """Read a key file.

        Raises
        ------
        InputError
            If it cannot be read or is not a key file. Its content is never part of the message.
        """
        try:
            text = read_small(Path(path), _MOST).decode("ascii")
        except UnicodeDecodeError:
            raise InputError("is not a meshmark key file", source=path) from None
        match = _TEXT.fullmatch(text)
        if match is None:
            raise InputError(
                "is not a meshmark key file; make one with `meshmark keygen`", source=path
            )
        return cls(bytes.fromhex(match.group(1)))


def words_of_keys(
    keys: Sequence[Key],
    scheme: str,
    numbers: Iterable[int],
    n_chips: int,
    recipients: Sequence[str | None] = (None,),
) -> NDArray[np.int8]:
    """Derive some of the code words of many keys and recipients, as `Key.words` derives each.

    Parameters
    ----------
    numbers : iterable of int
        Which of a scheme's words.

    Returns
    -------
    (len(keys), len(recipients), len(numbers), n_chips) int8
    """
    return signs_of(octets_of_keys(keys, scheme, numbers, n_chips, recipients), n_chips)


def octets_of_keys(
    keys: Sequence[Key],
    scheme: str,
    numbers: Iterable[int],
    n_chips: int,
    recipients: Sequence[str | None] = (None,),
) -> NDArray[np.uint8]:
    """Derive the same words a bit a chip, the most significant first.

    Returns
    -------
    (len(keys), len(recipients), len(numbers), -(-n_chips // 8)) uint8
    """
    n_bytes = -(-n_chips // 8)
    ends = [b"%d" % m for m in numbers]
    begun = [f"{_CONTEXT}word/{scheme}/{_whose(name)}/".encode() for name in recipients]
    labels = [label + end for label in begun for end in ends]
    if n_bytes <= DIGEST_BYTES:
        # The first block that HKDF yields is the code of a label and a one.
        octets = codes(
            [key._extracted for key in keys], [each + b"\x01" for each in labels], n_bytes
        )
    else:
        derived = [key._expanded(label, n_bytes) for key in keys for label in labels]
        octets = np.frombuffer(b"".join(derived), np.uint8)
    return octets.reshape(len(keys), len(begun), len(ends), n_bytes)


def signs_of(octets: NDArray[np.uint8], n_chips: int) -> NDArray[np.int8]:
    """Turn the bits of words (..., B) into signs, (..., n_chips) int8."""
    return 2 * np.unpackbits(octets, axis=-1, count=n_chips).astype(np.int8) - 1


def key_files(folder: Path) -> list[Path]:
    """List the key files of a folder, `*.key`.

    Raises
    ------
    InputError
        If the folder cannot be read.
    """
    try:
        return sorted(path for path in folder.iterdir() if path.suffix == KEY_SUFFIX)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=folder) from None


def keys_in(folder: Path) -> dict[str, Key]:
    """Read every key file of a folder, `*.key`, by key id.

    Raises
    ------
    InputError
        If the folder cannot be read, or one of the files is no key file.
    """
    return {key.id: key for key in map(Key.load, key_files(folder))}


def _whose(recipient: str | None) -> str:
    # A recipient's name is free text: its length keeps labels from running into each other.
    return "owner" if recipient is None else f"recipient/{len(recipient)}/{recipient}"


def readable_by_others(path: Path) -> bool:
    """Tell whether a key file's permissions let other users of the machine read it."""
    return bool(os.name == "posix" and path.stat().st_mode & (stat.S_IRGRP | stat.S_IROTH))
