"""The manifest beside a marked file: what was marked, how, and what became of it. No secrets."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshmark.files.atomic import written_beside

MANIFEST_SUFFIX = ".meshmark.json"
FORMAT = 1


@dataclass(frozen=True)
class Manifest:
    """A manifest as a document; its JSON Schema is `schemas/json/manifest.schema.json`.

    Parameters
    ----------
    document : dict
        JSON values only, no times of day: the same run gives the same bytes.
    path : Path or None
        Where it was written; None after a dry run.
    """

    document: dict[str, Any]
    path: Path | None = None

    def __getitem__(self, name: str) -> Any:
        return self.document[name]


def manifest_path(output: Path) -> Path:
    """Return the place of the manifest of a marked file or folder."""
    return output.with_name(output.name + MANIFEST_SUFFIX)


def write_json(document: dict[str, Any], path: Path) -> None:
    """Write JSON beside `path`, then put it in place.

    Raises
    ------
    OutputError
        If the folder cannot be written to.
    """
    write_text(json.dumps(document, indent=2, sort_keys=False, allow_nan=False) + "\n", path)


def write_text(text: str, path: Path) -> None:
    """Write text beside `path`, then put it in place; see `write_json`."""
    write_bytes(text.encode("utf-8"), path)


def write_bytes(data: bytes, path: Path) -> None:
    """Write bytes beside `path`, then put them in place; see `write_json`."""
    with written_beside(path) as file:
        file.write(data)


def file_hashes(files: Iterable[tuple[str, str]], folder: Path) -> list[dict[str, str]]:
    """Name hashed files relative to a folder.

    Parameters
    ----------
    files : iterable of (str, str)
        Absolute path and SHA-256; see `meshmark.sources.readers.source_digests`.

    Returns
    -------
    list of {"file", "sha256"}
        In the order given.
    """
    return [
        {"file": Path(os.path.relpath(file, folder)).as_posix(), "sha256": digest}
        for file, digest in files
    ]
