"""The manifest beside a marked file: what was marked, how, and what became of it. No secrets.

At no moment does the manifest of one output pass for that of another. Two files cannot be put in
place at once. So the manifest goes first and last: before an output is written, the manifest
beside it says that a run is under way, and what stands there as yet; after it was verified, the
manifest holds the output's own hashes.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshmark.c2pa.sidecar import sidecar_path
from meshmark.errors import InputError, UsageError
from meshmark.files.atomic import write_bytes, write_json
from meshmark.files.places import data_files
from meshmark.files.reading import read_small
from meshmark.sources.digests import sha256

MANIFEST_SUFFIX = ".meshmark.json"
FORMAT = 1
# Bytes of a manifest.
LONGEST = 1 << 26
NOTE = (
    "The run that this tells of is under way, or was broken off. A file that has the hashes below "
    "is what was there before, and the manifest below is its own; any other was never verified."
)

Hashes = list[dict[str, str]]


@dataclass(frozen=True)
class Manifest:
    """A manifest as a document; its JSON Schema is `schemas/json/manifest.schema.json`.

    Parameters
    ----------
    document : dict
        JSON values only, no times of day: the same run gives the same bytes.
    path : Path or None
        Where it was written; None after a dry run.
    kept : bool
        Whether it and its output were there already, and were left as they are.
    """

    document: dict[str, Any]
    path: Path | None = None
    kept: bool = False

    def __getitem__(self, name: str) -> Any:
        return self.document[name]


def manifest_path(output: Path) -> Path:
    """Return the place of the manifest of a marked file or folder."""
    return output.with_name(output.name + MANIFEST_SUFFIX)


def output_hashes(output: Path) -> Hashes:
    """Hash an output, a file and its data, or each file of a folder; nothing if it is missing.

    Returns
    -------
    list of {"file", "sha256"}
        Names are relative to the folder that the output is in.
    """
    files = sorted(output.iterdir()) if output.is_dir() else [output, *data_files(output)]
    return [
        {"file": file.relative_to(output.parent).as_posix(), "sha256": sha256(file)}
        for file in files
        if file.is_file()
    ]


@contextmanager
def announced(document: dict[str, Any], output: Path) -> Iterator[None]:
    """Let the manifest say what a run is about to do to an output, while the block does it.

    The block is to end with the manifest of what it wrote. If it is left by an exception and the
    output is what it was, so will be its manifest; if not, the announcement stays.

    Parameters
    ----------
    document : dict
        What is known of the output as yet.

    Raises
    ------
    InputError
        If what is in the manifest's place cannot be read.
    OutputError
        If it cannot be written. Nothing is changed in either case.
    """
    path = manifest_path(output)
    standing, content = output_hashes(output), _content(path)
    before = {"files": standing, "manifest": _manifest_of(standing, _parsed(content))}
    write_json({**document, "unfinished": {"note": NOTE, **before}}, path)
    try:
        yield
    except BaseException:
        if output_hashes(output) == standing:
            _put_back(content, path)
        raise


def own_manifest(output: Path) -> dict[str, Any] | None:
    """Read the manifest beside a file or folder if it is its own, of a run that was finished."""
    try:
        found = _parsed(_content(manifest_path(output)))
    except InputError:
        return None
    if found is None or "unfinished" in found or not output.exists():
        return None
    return found if _same(found.get("output_files"), output_hashes(output)) else None


def made_before(document: dict[str, Any], output: Path) -> Manifest | None:
    """Return the manifest of an output that a run like this one has made, as it left it.

    Parameters
    ----------
    document : dict
        What is known of the output before it is made.
    """
    found = own_manifest(output)
    said = json.loads(json.dumps(document))
    if found is None or any(found.get(name) != value for name, value in said.items()):
        return None
    if "c2pa" in found and not _same([found["c2pa"]], _sidecar_hashes(output)):
        return None
    return Manifest(found, manifest_path(output), kept=True)


def require_unmarked(source: Path, key_id: str) -> None:
    """Refuse to mark what the same key has marked before: marks would pile up.

    Raises
    ------
    UsageError
        If the manifest beside it says so.
    """
    found = own_manifest(source)
    if found is not None and found.get("key_id") == key_id:
        raise UsageError("is marked by this key; mark what it was made of", source=source)


def remark(output: Path) -> str | None:
    """Say what is wrong with the manifest beside a file or folder; None if it is its own.

    There may be none, or one of an older version, which does not tell what it belongs to.
    """
    try:
        content = _content(manifest_path(output))
    except InputError as error:
        return f"the manifest beside it {error.message}"
    if content is None or not output.exists():
        return None
    found = _parsed(content)
    if found is None:
        return "the manifest beside it is none"
    standing = output_hashes(output)
    unfinished = found.get("unfinished")
    if isinstance(unfinished, dict):
        if _same(unfinished.get("files"), standing):
            return "the manifest beside it is of a run that has not replaced it"
        return "the manifest beside it is of a run that was not finished; this was not verified"
    if "output_files" in found and not _same(found["output_files"], standing):
        return "the manifest beside it is of another file: the hashes differ"
    return None


def named_schemes(output: Path) -> tuple[str, ...]:
    """List the schemes that a manifest beside a file or folder names, whosoever it is.

    Whoever tries them has to correct for their number, and takes nothing else from it: it may have
    been written to mislead.
    """
    try:
        found = _parsed(_content(manifest_path(output)))
    except InputError:
        return ()
    layers = (found or {}).get("layers")
    if not isinstance(layers, list):
        return ()
    names = [each.get("name") for each in layers if isinstance(each, dict)]
    return tuple(dict.fromkeys(name for name in names if isinstance(name, str)))


def _manifest_of(standing: Hashes, found: dict[str, Any] | None) -> dict[str, Any] | None:
    """Choose what speaks of the output that stands: a manifest, what it replaced, or nothing."""
    if found is None or not standing:
        return None
    unfinished = found.get("unfinished")
    if not isinstance(unfinished, dict):
        return found if _same(found.get("output_files", standing), standing) else None
    if _same(unfinished.get("files"), standing):
        manifest = unfinished.get("manifest")
        return manifest if isinstance(manifest, dict) else None
    return {name: value for name, value in found.items() if name != "unfinished"}


def _sidecar_hashes(output: Path) -> Hashes:
    place = sidecar_path(output)
    return [{"file": place.name, "sha256": sha256(place)}] if place.is_file() else []


def _same(told: Any, standing: Hashes) -> bool:
    """Compare hashes that a manifest tells; a copy under another name is the same copy."""
    if not isinstance(told, list) or not all(isinstance(each, dict) for each in told):
        return False
    if len(told) == len(standing) == 1:
        return bool(told[0].get("sha256") == standing[0]["sha256"])
    return _by_name(told) == _by_name(standing)


def _by_name(files: Hashes) -> list[tuple[str, str]]:
    """List names within the folder that an output is, if it is one, and hashes."""
    return sorted(
        (str(each.get("file")).partition("/")[2], str(each.get("sha256"))) for each in files
    )


def _content(path: Path) -> bytes | None:
    """Read a manifest, whoever wrote it; None if there is none."""
    return read_small(path, LONGEST) if path.exists() else None


def _parsed(content: bytes | None) -> dict[str, Any] | None:
    try:
        document = None if content is None else json.loads(content)
    except (ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) else None


def _put_back(content: bytes | None, path: Path) -> None:
    if content is None:
        path.unlink(missing_ok=True)
    else:
        write_bytes(content, path)
