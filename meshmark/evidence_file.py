"""Evidence on disk: measured once, tried with any number of keys later."""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from meshmark.errors import InputError
from meshmark.evidence import Evidence
from meshmark.manifest import written_beside
from meshmark.placement import WINDOW, Placement
from meshmark.records import read_records, write_records
from meshmark.spool import Made, Spool
from meshmark.strand import FrameEvidence, Strand

FORMAT = "meshmark-evidence-2"


@dataclass(frozen=True, eq=False)
class StoredEvidence:
    """Evidence of a source, and what it was measured on and with.

    Parameters
    ----------
    files : tuple of (str, str)
        Name and SHA-256 of every file of the source.
    recipes : sequence
        Schemes with all their parameters, as `Recipe.as_json` gives them.
    frames : str or None
        Range of time codes that was asked for.
    items : tuple of Evidence
        One for each mesh and scheme that could be measured.
    notes : tuple of str
        What was not measured, and why.
    """

    files: tuple[tuple[str, str], ...]
    recipes: Sequence[Any]
    frames: str | None
    items: tuple[Evidence, ...]
    notes: tuple[str, ...]


def save_evidence(stored: StoredEvidence, path: Path) -> None:
    """Write evidence to a file; it holds nothing of a key, nor of the mesh itself.

    Raises
    ------
    OutputError
        If it cannot be written; nothing half-written is left.
    """
    header = {
        "format": FORMAT,
        "files": [list(pair) for pair in stored.files],
        "recipes": list(stored.recipes),
        "frames": stored.frames,
        "items": [_described(item) for item in stored.items],
        "notes": list(stored.notes),
    }
    with (
        written_beside(path) as file,
        zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        _write_array(archive, "header", np.array(json.dumps(header)))
        for i, item in enumerate(stored.items):
            _write_array(archive, f"times{i}", item.times)
            for j, strand in enumerate(item.strands):
                _write_strand(archive, f"{i}.{j}", strand)


def _described(item: Evidence) -> dict[str, Any]:
    return {
        "prim": item.prim,
        "scheme": item.scheme,
        "n_words": item.n_words,
        "tracked": item.tracked,
        "decisive": item.decisive,
        "strands": [
            {
                "restored": strand.restored,
                "log_belief": strand.log_belief,
                "placed": strand.placements is not None,
            }
            for strand in item.strands
        ],
    }


def _write_array(archive: zipfile.ZipFile, name: str, array: NDArray[Any]) -> None:
    with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
        npy.write_array(file, array, allow_pickle=False)


def _write_strand(archive: zipfile.ZipFile, suffix: str, strand: Strand) -> None:
    T, R, C, K = strand.shape
    steps = (frame.steps for frame in strand.frames)
    write_records(archive, f"steps{suffix}", steps, (T, R, C, K), np.int8)
    _write_array(archive, f"prior{suffix}", strand.log_prior)
    placements = strand.placements
    if placements is not None:
        places, doubts = (p.place for p in placements), (p.doubt for p in placements)
        write_records(archive, f"place{suffix}", places, (T, R, C), np.float64)
        write_records(archive, f"doubt{suffix}", doubts, (T, C), np.float64)


def load_evidence(path: Path) -> StoredEvidence:
    """Read evidence from a file.

    Raises
    ------
    InputError
        If it cannot be read, or is no evidence of this format.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            header = json.loads(str(file["header"]))
            if header["format"] != FORMAT:
                raise InputError(f"is not of the format {FORMAT}", source=path)
            spool: Spool[FrameEvidence] = Spool()
            return StoredEvidence(
                files=tuple((str(name), str(digest)) for name, digest in header["files"]),
                recipes=list(header["recipes"]),
                frames=header["frames"],
                items=tuple(_item(file, i, item, spool) for i, item in enumerate(header["items"])),
                notes=tuple(header["notes"]),
            )
    except OSError as error:
        raise InputError(f"cannot read the evidence: {error.strerror}", source=path) from None
    except (
        ValueError,
        KeyError,
        TypeError,
        EOFError,
        RuntimeError,
        zipfile.BadZipFile,
        zlib.error,
    ):
        raise InputError("is not an evidence file of meshmark's", source=path) from None


def _item(
    file: NpzFile, i: int, described: dict[str, Any], spool: Spool[FrameEvidence]
) -> Evidence:
    n_words = int(described["n_words"])
    strands = tuple(
        _strand(file, f"{i}.{j}", strand, n_words, spool)
        for j, strand in enumerate(described["strands"])
    )
    times = file[f"times{i}"].astype(np.float64)
    if not strands or any(times.shape != (strand.shape[0],) for strand in strands):
        raise ValueError("shapes")
    return Evidence(
        prim=str(described["prim"]),
        scheme=str(described["scheme"]),
        n_words=n_words,
        times=times,
        strands=strands,
        tracked=bool(described["tracked"]),
        decisive=_checked_decisive(described.get("decisive", 0.0)),
    )


def _strand(
    file: NpzFile,
    suffix: str,
    described: dict[str, Any],
    n_words: int,
    spool: Spool[FrameEvidence],
) -> Strand:
    # Older files do not say so.
    placed = described.get("placed", f"place{suffix}" in file)
    numbers = [spool.add(frame) for frame in _frames(file, suffix, placed, n_words)]
    if not numbers:
        raise ValueError("no frame")
    strand = Strand(
        restored=int(described["restored"]),
        log_belief=float(described["log_belief"]),
        log_prior=file[f"prior{suffix}"].astype(np.float64),
        frames=Made(lambda t: spool[numbers[t]], len(numbers)),
    )
    if strand.log_prior.shape != (strand.shape[1],):
        raise ValueError("shapes")
    # Belief beyond 1 would make any key look right.
    if not np.exp(strand.belief).sum() <= 1.0 + 1e-9:
        raise ValueError("belief")
    return strand


def _frames(file: NpzFile, suffix: str, placed: bool, n_words: int) -> Iterator[FrameEvidence]:
    """Read the frames of a strand, one at a time."""
    archive = file.zip
    assert archive is not None
    steps = read_records(archive, f"steps{suffix}", np.int8)
    if not placed:
        for record in steps:
            yield _checked(FrameEvidence(record), n_words)
        return
    places = read_records(archive, f"place{suffix}", np.float64)
    doubts = read_records(archive, f"doubt{suffix}", np.float64)
    for record, place, doubt in zip(steps, places, doubts, strict=True):
        yield _checked(FrameEvidence(record, Placement(place, doubt)), n_words)


def _checked(frame: FrameEvidence, n_words: int) -> FrameEvidence:
    R, C, _ = frame.steps.shape
    placement = frame.placement
    if placement is None:
        return frame
    if (placement.place.shape, placement.doubt.shape) != ((R, C), (C,)):
        raise ValueError("shapes")
    if not np.all((placement.doubt > 0.0) & (placement.doubt <= 1.0)):
        raise ValueError("doubt")
    place = placement.place[~np.isnan(placement.place)]
    if n_words < WINDOW or not np.all((place >= 0.0) & (place <= n_words - 1)):
        raise ValueError("place")
    return frame


def _checked_decisive(value: Any) -> float:
    decisive = float(value)
    if not 0.0 <= decisive < 1.0:
        raise ValueError("decisive")
    return decisive
