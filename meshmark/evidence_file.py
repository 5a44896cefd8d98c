"""Evidence on disk: measured once, tried with any number of keys later."""

from __future__ import annotations

import io
import json
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from meshmark.errors import InputError
from meshmark.evidence import Evidence, Strand
from meshmark.manifest import write_bytes
from meshmark.placement import WINDOW, Placement

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
    arrays: dict[str, Any] = {}
    described = []
    for i, item in enumerate(stored.items):
        arrays[f"times{i}"] = item.times
        strands = []
        for j, strand in enumerate(item.strands):
            arrays[f"steps{i}.{j}"] = strand.steps
            arrays[f"prior{i}.{j}"] = strand.log_prior
            if strand.placements is not None:
                arrays[f"place{i}.{j}"] = np.array([p.place for p in strand.placements])
                arrays[f"doubt{i}.{j}"] = np.array([p.doubt for p in strand.placements])
            strands.append({"restored": strand.restored, "log_belief": strand.log_belief})
        described.append(
            {
                "prim": item.prim,
                "scheme": item.scheme,
                "n_words": item.n_words,
                "tracked": item.tracked,
                "decisive": item.decisive,
                "strands": strands,
            }
        )
    header = {
        "format": FORMAT,
        "files": [list(pair) for pair in stored.files],
        "recipes": list(stored.recipes),
        "frames": stored.frames,
        "items": described,
        "notes": list(stored.notes),
    }
    buffer = io.BytesIO()
    np.savez_compressed(buffer, header=np.array(json.dumps(header)), **arrays)
    write_bytes(buffer.getvalue(), path)


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
            return StoredEvidence(
                files=tuple((str(name), str(digest)) for name, digest in header["files"]),
                recipes=list(header["recipes"]),
                frames=header["frames"],
                items=tuple(_item(file, i, item) for i, item in enumerate(header["items"])),
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


def _item(file: Any, i: int, described: dict[str, Any]) -> Evidence:
    strands = tuple(
        Strand(
            restored=int(strand["restored"]),
            log_belief=float(strand["log_belief"]),
            log_prior=file[f"prior{i}.{j}"].astype(np.float64),
            steps=_checked_steps(file[f"steps{i}.{j}"]),
            placements=_placements(file, f"{i}.{j}"),
        )
        for j, strand in enumerate(described["strands"])
    )
    times = file[f"times{i}"].astype(np.float64)
    for strand in strands:
        T, R, *_ = strand.steps.shape
        if len(times) != T or strand.log_prior.shape != (R,):
            raise ValueError("shapes")
        # Belief beyond 1 would make any key look right.
        if np.exp(strand.belief).sum() > 1.0 + 1e-9:
            raise ValueError("belief")
        for placement in strand.placements or ():
            _check(placement, strand, int(described["n_words"]))
    if not strands:
        raise ValueError("no strand")
    return Evidence(
        prim=str(described["prim"]),
        scheme=str(described["scheme"]),
        n_words=int(described["n_words"]),
        times=times,
        strands=strands,
        tracked=bool(described["tracked"]),
        decisive=_checked_decisive(described.get("decisive", 0.0)),
    )


def _placements(file: Any, suffix: str) -> tuple[Placement, ...] | None:
    if f"place{suffix}" not in file:
        return None
    place, doubt = (file[f"{name}{suffix}"].astype(np.float64) for name in ("place", "doubt"))
    return tuple(map(Placement, place, doubt))


def _check(placement: Placement, strand: Strand, n_words: int) -> None:
    T, R, C, _ = strand.steps.shape
    shapes = (len(strand.placements or ()), placement.place.shape, placement.doubt.shape)
    if shapes != (T, (R, C), (C,)):
        raise ValueError("shapes")
    if not np.all((placement.doubt > 0.0) & (placement.doubt <= 1.0)):
        raise ValueError("doubt")
    place = placement.place[~np.isnan(placement.place)]
    if n_words < WINDOW or not np.all((place >= 0.0) & (place <= n_words - 1)):
        raise ValueError("place")


def _checked_decisive(value: Any) -> float:
    decisive = float(value)
    if not 0.0 <= decisive < 1.0:
        raise ValueError("decisive")
    return decisive


def _checked_steps(steps: Any) -> Any:
    if steps.dtype != np.int8 or steps.ndim != 4:
        raise ValueError("steps")
    return steps
