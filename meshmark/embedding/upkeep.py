"""Whether marked files still are what their manifests say, and their sources what was marked."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshmark.embedding.description import stamps_told
from meshmark.embedding.manifest import LONGEST, manifest_path, remark
from meshmark.errors import InputError
from meshmark.files.reading import read_small
from meshmark.sources.digests import sha256
from meshmark.usd.findings import Finding
from meshmark.usd.stamp import Stamp

# What reading a manifest raises that is none.
_NONSENSE = (ValueError, KeyError, TypeError, RecursionError)


@dataclass(frozen=True)
class Told:
    """What the manifest beside a file tells of it.

    Parameters
    ----------
    marked, skipped : tuple of str
        Paths of the meshes that hold a mark, and of those that are known to hold none.
    stamps : tuple of Stamp
        Of the marked ones.
    delivered : bool
        Whether the file is one that nothing unmarked may be in.
    """

    marked: tuple[str, ...] = ()
    skipped: tuple[str, ...] = ()
    stamps: tuple[Stamp, ...] = ()
    delivered: bool = False


def told_of(file: Path) -> Told:
    """Read what the manifest beside a file tells; nothing, if there is none.

    Raises
    ------
    InputError
        If what lies there is no manifest.
    """
    document = _manifest(file)
    if document is None:
        return Told()
    try:
        return Told(
            tuple(str(each["prim"]) for each in document["prims"]),
            tuple(str(each["prim"]) for each in document["skipped"]),
            tuple(stamps_told(document).values()),
            document["delivered"] is True,
        )
    except _NONSENSE as error:
        raise _no_manifest(file, error) from None


def stale(file: Path, beat: Callable[[], None] = lambda: None) -> list[Finding]:
    """Tell whether a file is another than its manifest's, or its source another than was marked.

    A deliverable needs no source.

    Raises
    ------
    InputError
        If what lies beside it is no manifest.
    """
    document = _manifest(file)
    if document is None:
        return []
    wrong = remark(file)
    found = [] if wrong is None else [Finding("stale", file.name, wrong)]
    try:
        sources = () if document["delivered"] is True else document["source"]["files"]
        for each in sources:
            beat()
            reason = _changed(file.parent.resolve() / each["file"], each["sha256"], beat)
            if reason:
                found.append(Finding("stale", each["file"], f"a source of {file.name}: {reason}"))
    except _NONSENSE as error:
        raise _no_manifest(file, error) from None
    return found


def unmarked_frames(file: Path) -> list[Finding]:
    """Tell of the meshes of which only some frames were marked; frames without a size do not count.

    Raises
    ------
    InputError
        If what lies beside the file is no manifest.
    """
    document = _manifest(file)
    if document is None:
        return []
    try:
        counts = [
            (str(each["prim"]), each["frames"], each["marked_frames"] + len(each["passed_over"]))
            for each in document["prims"]
        ]
        return [
            Finding("frames", prim, f"{n - done} of {n} frames in {file.name} are not marked")
            for prim, n, done in counts
            if done < n
        ]
    except _NONSENSE as error:
        raise _no_manifest(file, error) from None


def _manifest(file: Path) -> dict[str, Any] | None:
    path = manifest_path(file)
    if not path.is_file():
        return None
    try:
        document = json.loads(read_small(path, LONGEST))
    except _NONSENSE as error:
        raise _no_manifest(file, error) from None
    if not isinstance(document, dict):
        raise _no_manifest(file, "no object")
    return document


def _no_manifest(file: Path, error: object) -> InputError:
    return InputError(f"is no manifest: {error}", source=manifest_path(file))


def _changed(path: Path, digest: str, beat: Callable[[], None]) -> str:
    try:
        return "" if sha256(path, beat) == digest else "changed since it was marked"
    except InputError as error:
        return error.message
