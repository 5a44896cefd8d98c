"""Evidence of many sources in one folder, as Parquet: measured once, tried with any key later.

Whoever measured a source writes a file of its own, named by what was measured and how, and puts it
in place in one step. So any number of processes add to a folder at once, nobody sees half a
file, and what is measured twice is there once.

A row is a source. What counts of it is the column `evidence`: the bytes of a sealed evidence file
(`evidence_file.py`). All other columns are for people, and repeat what those bytes say. Columns
are neither compressed nor put into dictionaries, so that nothing read is larger than its file.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from meshmark.detection.evidence import Evidence, RestoredVariant
from meshmark.detection.evidence_file import StoredEvidence, evidence_bytes, evidence_of
from meshmark.detection.gathering import AssetEvidence
from meshmark.detection.looks import ONE_LOOK
from meshmark.detection.parquet_footer import require_plain
from meshmark.errors import InputError, OutputError, UsageError
from meshmark.files.atomic import write_bytes
from meshmark.files.reading import opened

SUFFIX = ".parquet"
ADVICE = "pip install 'meshmark[arrow]'"
# The one column that is believed, once its seal is found whole.
EVIDENCE = "evidence"
# What a stranger's file may say of itself in words, in bytes.
_FOOTER = 1 << 24


def require_arrow() -> None:
    """Refuse to go on without what reads and writes Parquet.

    Raises
    ------
    UsageError
        If it is not installed.
    """
    if find_spec("pyarrow") is None:
        raise UsageError(f"a store needs pyarrow, which is not installed: {ADVICE}")


class EvidenceStore:
    """A folder of evidence.

    Parameters
    ----------
    folder : Path
        Made when something is added.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    # What is not authentic is never found.
    authenticated = True
    look = ONE_LOOK

    def add(self, stored: StoredEvidence) -> StoredEvidence:
        """Keep the evidence of a source, all frames of a mesh put together; return what is kept.

        Raises
        ------
        OutputError
            If it cannot be written; nothing half-written is left.
        """
        kept = replace(stored, items=tuple(map(all_frames_together, stored.items)))
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot be made: {error.strerror}", source=self.folder) from None
        write_bytes(_as_parquet(kept), self._path(kept))
        return kept

    def find(self, wanted: StoredEvidence, source: str = "") -> StoredEvidence | None:
        """Return the evidence of the same bytes by the same recipes and options, if it is kept.

        What is not authentic is not there.
        """
        path = self._path(wanted)
        if not path.exists():
            return None
        try:
            found = [row.load() for row in rows(path)]
        except InputError:
            return None
        same = identity(wanted)
        return next((each for each in found if identity(each) == same), None)

    def paths(self) -> list[Path]:
        """List the files.

        Raises
        ------
        InputError
            If the folder cannot be read.
        """
        try:
            return sorted(path for path in self.folder.iterdir() if path.suffix == SUFFIX)
        except OSError as error:
            raise InputError(f"cannot be read: {error.strerror}", source=self.folder) from None

    def _path(self, stored: StoredEvidence) -> Path:
        return self.folder / f"{identity(stored)}{SUFFIX}"


@dataclass(frozen=True, eq=False)
class Row:
    """A source's evidence in a file.

    Parameters
    ----------
    place : str
        File and row, to name it by.
    data : bytes
        What may be a sealed evidence file.
    """

    place: str
    data: bytes

    def load(self, *, authenticated: bool = True) -> StoredEvidence:
        """Read the evidence; see `meshmark.detection.evidence_file.load_evidence`."""
        return evidence_of(self.data, self.place, authenticated=authenticated)


def rows(path: Path) -> Iterator[Row]:
    """Read the rows of a file, one group of them after the other.

    Raises
    ------
    InputError
        If it cannot be read, or is not as `EvidenceStore` writes files.
    """
    import pyarrow as pa
    from pyarrow import parquet

    with opened(path) as file:
        try:
            require_plain(file, _FOOTER)
            file.seek(0)
            table = parquet.ParquetFile(
                file,
                thrift_string_size_limit=_FOOTER,
                thrift_container_size_limit=_FOOTER,
            )
            _require_binary(table)
            number = 0
            for group in range(table.metadata.num_row_groups):
                for value in table.read_row_group(group, [EVIDENCE], use_threads=False)[EVIDENCE]:
                    number += 1
                    yield Row(f"{path}: row {number}", value.as_py() or b"")
        except (pa.ArrowException, ValueError, OverflowError, MemoryError, OSError) as error:
            if isinstance(error, OSError) and error.errno is not None:
                raise
            raise InputError("is not a file of a store of evidence", source=path) from None


def _require_binary(table: Any) -> None:
    """Refuse a file whose evidence, of which there is one column, is anything but bytes."""
    schema = table.schema_arrow
    if schema.names.count(EVIDENCE) != 1 or str(schema.field(EVIDENCE).type) != "binary":
        raise ValueError("type")


def _as_parquet(stored: StoredEvidence) -> bytes:
    import pyarrow as pa
    from pyarrow import parquet

    columns = {
        "path": [stored.path],
        "sha256": [content_hash(stored)],
        "recipes": [_canonical(stored.recipes)],
        "frames": [stored.frames or ":"],
        "informed": [any(item.informed is not None for item in stored.items)],
        "meshes": [len({item.prim for item in stored.items})],
        "version": [stored.version],
        EVIDENCE: pa.array([evidence_bytes(stored)], pa.binary()),
    }
    data = BytesIO()
    parquet.write_table(
        pa.table(columns), data, compression="none", use_dictionary=False, write_statistics=False
    )
    return data.getvalue()


def identity(stored: StoredEvidence) -> str:
    """Hash what was measured, and how: bytes of all files, recipes, frames, readers' parameters."""
    said = [
        [digest for _, digest in stored.files],
        [digest for _, digest in stored.original],
        stored.recipes,
        stored.frames,
        dict(stored.parameters),
    ]
    return hashlib.sha256(_canonical(said).encode()).hexdigest()


def content_hash(stored: StoredEvidence) -> str:
    """Return the SHA-256 of a source: of its only file, or of the hashes of all of them."""
    digests = [digest for _, digest in stored.files]
    if len(digests) == 1:
        return digests[0]
    return hashlib.sha256("\n".join(digests).encode()).hexdigest()


def _canonical(document: Any) -> str:
    return json.dumps(document, sort_keys=True, separators=(",", ":"))


def asset_evidence(stored: StoredEvidence, *, authenticated: bool = True) -> AssetEvidence:
    """Turn what is stored into what keys are tried on."""
    beside = {item.scheme for item in stored.items if item.informed is not None}
    names = [recipe["scheme"]["name"] for recipe in stored.recipes]
    return AssetEvidence(
        source=stored.path or ", ".join(name for name, _ in stored.files),
        items=stored.items,
        n_schemes=sum(name not in beside for name in names),
        notes=stored.notes,
        elapsed_s=0.0,
        authenticated=authenticated,
        original=stored.original[0][0] if stored.original else None,
    )


def all_frames_together(item: Evidence) -> Evidence:
    """Put all frames of a mesh together into one, which has no time of its own.

    A sum of signed numbers that were measured without the key is again one, rounded or not.
    """
    if len(item.times) == 1:
        return item
    variants = tuple(
        RestoredVariant.of(
            variant.pooled[None],
            variant.log_prior,
            variant.restored,
            variant.log_belief,
            None if variant.posterior is None else (variant.posterior,),
        )
        for variant in item.variants
    )
    return replace(item, times=np.array([np.nan]), variants=variants)
