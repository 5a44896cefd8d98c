"""Hashes the files of a source: which those are, a process of its own finds out."""

from __future__ import annotations

import sys
from pathlib import Path

from meshmark.sources.digests import sha256
from meshmark.sources.facts import source_files
from meshmark.sources.isolation.child import Child
from meshmark.sources.isolation.reading import isolated


def digests_of(source: str, *, trusted: bool = False) -> tuple[tuple[str, str], ...]:
    """Return the absolute path and the SHA-256 of each file a source consists of.

    Parameters
    ----------
    trusted : bool
        Find out in this process.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    if trusted:
        files = (path.resolve() for path in source_files(source))
        return tuple((str(path), sha256(path)) for path in files)
    with isolated(__name__, source) as (report, _):
        return tuple((str(file), str(digest)) for file, digest in report["files"])


def main() -> None:
    """Hash what the command line says."""
    folder, source = sys.argv[1:]
    child = Child(Path(folder), source)
    child.run(lambda: {"files": child.digests(child.files())})


if __name__ == "__main__":
    main()
