"""The files a page is about, and their hashes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from meshmark.commands.verification import Request
from meshmark.commands.verify import original_of
from meshmark.embedding.manifest import output_hashes
from meshmark.ledger.origins import Origin
from meshmark.mesh.asset import Asset
from meshmark.sources.digests import require_unchanged, sha256, source_digests
from meshmark.sources.isolation.hashing import digests_of
from meshmark.sources.readers import parameters_for
from meshmark.sources.reading import read


@dataclass(frozen=True)
class Hashed:
    """One file.

    Parameters
    ----------
    role : str
        What it is here: "copy", "original".
    path : str
        Absolute.
    digest : str
        SHA-256.
    """

    role: str
    path: str
    digest: str

    @property
    def told(self) -> tuple[str, str]:
        """Role and name, without the folder, which is nobody's business; and the hash."""
        return f"{self.role}: {Path(self.path).name}", self.digest


@dataclass(frozen=True, eq=False)
class Sources:
    """What a copy is read beside.

    Parameters
    ----------
    copy : Asset
    original : Asset or None
    files : tuple of Hashed
        Of both, of the master and of whatever else there is.
    """

    copy: Asset
    original: Asset | None
    files: tuple[Hashed, ...]

    def beside(self, origin: Origin) -> Sources:
        """Add the original that a ledger names, and its master if that is there."""
        original = read(origin.source, parameters=origin.parameters or None, isolated=True)
        files = [*self.files, *hashed("original", original)]
        if origin.master is not None:
            path = Path(origin.master["path"])
            found = output_hashes(path)
            if found == origin.master["files"]:
                files += [
                    Hashed("master", str(path.parent / each["file"]), each["sha256"])
                    for each in found
                ]
        return replace(self, original=original, files=tuple(files))

    def require_unchanged(self) -> None:
        """Refuse to tell of files that were changed meanwhile; see `require_unchanged`."""
        require_unchanged((file.path, file.digest) for file in self.files)


def read_sources(source: str, request: Request, others: Sequence[tuple[str, Path]]) -> Sources:
    """Read a copy and its original, and hash them, the master and other files.

    Parameters
    ----------
    source : str
        The copy.
    request : Request
        Names original and master.
    others : sequence of (str, Path)
        Role and place of further files.

    Raises
    ------
    InputError
        If one cannot be read.
    """
    beside = request.original is not None
    parameters = parameters_for(source, request.parameters, copy=beside)
    copy = read(source, parameters=parameters, isolated=not request.trusted)
    original = original_of(request) if beside else None
    files = hashed("copy", copy)
    if original is not None:
        files += hashed("original", original)
    if request.master is not None:
        digests = digests_of(request.master, trusted=request.trusted)
        files += [Hashed("master", *each) for each in digests]
    files += [Hashed(role, str(path.resolve()), sha256(path)) for role, path in others]
    return Sources(copy, original, tuple(files))


def hashed(role: str, asset: Asset) -> list[Hashed]:
    """List the files of an asset."""
    return [Hashed(role, path, digest) for path, digest in source_digests(asset)]
