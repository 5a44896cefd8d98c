"""Evidence on disk: measured once, tried with any number of keys later.

An evidence file is sealed (`sealing.py`). Under the seal is one gzip stream: the length of the
header in four bytes, the header as JSON (`evidence_header.py`), and the arrays it tells of, each
without a break after the other, little-endian, frame by frame. Nothing in it says its own size.
"""

from __future__ import annotations

import gzip
import struct
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from meshmark.detection.evidence import (
    STEPS,
    Evidence,
    FrameEvidence,
    LazySequence,
    RestoredVariant,
)
from meshmark.detection.evidence_header import (
    EXPANSION,
    LONGEST,
    ItemHeader,
    RestorationHeader,
    header_text,
    parse_header,
)
from meshmark.detection.sealing import Sealing, sealed, sealed_into, unsealed, unsealed_from
from meshmark.detection.vertex_evidence import VertexEvidence
from meshmark.errors import InputError
from meshmark.statistics.word_windows import WordPosterior
from meshmark.workers.disk_list import DiskList

FORMAT = "meshmark-evidence-4"
KIND = f"{FORMAT}\n".encode()

_LENGTH = struct.Struct("<I")
_STEP, _VERTEX, _REAL = np.dtype("<i1"), np.dtype("<i2"), np.dtype("<f8")
# What sums of beliefs may exceed 1 by.
_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class StoredEvidence:
    """Evidence of a source, and what it was measured on and with.

    Parameters
    ----------
    files : tuple of (str, str)
        Name and SHA-256 of every file of the source.
    original : tuple of (str, str)
        The same of what the source was measured beside: the original, then the master; empty
        where it was measured by itself.
    recipes : sequence
        Schemes with all their parameters, as `Recipe.as_json` gives them.
    frames : str or None
        Range of time codes that was asked for.
    items : tuple of Evidence
        One for each mesh and scheme that could be measured.
    notes : tuple of str
        What was not measured, and why.
    parameters : mapping
        What readers were given, by name: texts, numbers and lists of texts.
    path : str
        Where the source was, if that is kept.
    version : str
        Of the meshmark that measured it, if that is kept.
    """

    files: tuple[tuple[str, str], ...]
    original: tuple[tuple[str, str], ...]
    recipes: Sequence[Any]
    frames: str | None
    items: tuple[Evidence, ...]
    notes: tuple[str, ...]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    path: str = ""
    version: str = ""


def save_evidence(stored: StoredEvidence, path: Path) -> None:
    """Write evidence to a sealed file; it holds nothing of a key, nor of the mesh itself.

    Raises
    ------
    OutputError
        If it cannot be written; nothing half-written is left.
    """
    with sealed(path, KIND) as file:
        _write_all(stored, file)


def evidence_bytes(stored: StoredEvidence) -> bytes:
    """Return what `save_evidence` would write to a file."""
    data = BytesIO()
    with sealed_into(data, KIND) as file:
        _write_all(stored, file)
    return data.getvalue()


def _write_all(stored: StoredEvidence, file: Sealing) -> None:
    header = header_text(
        stored.files,
        stored.original,
        stored.recipes,
        stored.frames,
        stored.notes,
        stored.items,
        stored.parameters,
        stored.path,
        stored.version,
    ).encode()
    # No time of day: equal evidence gives equal bytes.
    with gzip.GzipFile("", "wb", 6, file, mtime=0) as stream:
        stream.write(_LENGTH.pack(len(header)) + header)
        for item in stored.items:
            _write(stream, item.times, _REAL)
            for variant in item.variants:
                _write_strand(stream, variant)
            if item.vertices is not None:
                _write(stream, item.vertices.steps, _VERTEX)


def _write_strand(stream: gzip.GzipFile, variant: RestoredVariant) -> None:
    _write(stream, variant.log_prior, _REAL)
    for frame in variant.frames:
        _write(stream, frame.steps, _STEP)
        if frame.posterior is not None:
            _write(stream, frame.posterior.position, _REAL)
            _write(stream, frame.posterior.p_null, _REAL)


def _write(stream: gzip.GzipFile, array: NDArray[Any], kind: np.dtype[Any]) -> None:
    stream.write(array.astype(kind, order="C", copy=False).tobytes())


def load_evidence(path: Path, *, authenticated: bool = True) -> StoredEvidence:
    """Read evidence from a file.

    Parameters
    ----------
    authenticated : bool
        Whether to ask for the seal of the local secret. Without, anybody may have written what
        is read, and no verdict can rest on it.

    Raises
    ------
    InputError
        If it cannot be read, is not authentic, or is no evidence of this format.
    """
    with unsealed(path, KIND, authenticated=authenticated) as content:
        return _loaded(content, path, authenticated)


def evidence_of(data: bytes, source: object, *, authenticated: bool = True) -> StoredEvidence:
    """Read evidence from the bytes of a file; `source` names it. See `load_evidence`."""
    with unsealed_from(BytesIO(data), KIND, source, authenticated=authenticated) as content:
        return _loaded(content, source, authenticated)


def _loaded(content: IO[bytes], source: object, trusted: bool) -> StoredEvidence:
    try:
        return _parsed(content, trusted)
    except (ValueError, EOFError, OSError, zlib.error):
        raise InputError("is not an evidence file of meshmark's", source=source) from None


def _parsed(content: IO[bytes], trusted: bool) -> StoredEvidence:
    size = content.seek(0, 2)
    content.seek(0)
    with gzip.GzipFile(fileobj=content, mode="rb") as stream:
        (length,) = _LENGTH.unpack(_read(stream, _LENGTH.size))
        if length > LONGEST:
            raise ValueError("header")
        header = parse_header(_read(stream, length).decode())
        if not trusted and header.n_bytes > EXPANSION * size:
            raise ValueError("size")
        disk_list: DiskList[FrameEvidence] = DiskList()
        items = tuple(_item(stream, item, disk_list) for item in header.items)
        # The end is where checksums are compared.
        if stream.read(1):
            raise ValueError("too long")
    return StoredEvidence(
        header.files,
        header.original,
        header.recipes,
        header.frames,
        items,
        header.notes,
        header.parameters,
        header.path,
        header.version,
    )


def _item(
    stream: gzip.GzipFile, header: ItemHeader, disk_list: DiskList[FrameEvidence]
) -> Evidence:
    times = _array(stream, (header.n_frames,), _REAL)
    # A single file without a clock has no time, which is NaN.
    _require(not np.isinf(times).any(), "times")
    variants = tuple(_strand(stream, header, variant, disk_list) for variant in header.variants)
    # Belief beyond 1 would make any key look right.
    belief = sum(float(np.exp(variant.belief).sum()) for variant in variants)
    _require(belief <= 1.0 + _ROUNDING, "belief")
    steps = _array(stream, (header.n_vertices,), _VERTEX)
    return Evidence(
        prim=header.prim,
        scheme=header.scheme,
        n_words=header.n_words,
        times=times,
        variants=variants,
        tracked=header.tracked,
        bit_threshold=header.bit_threshold,
        part=header.part,
        also=header.also,
        informed=header.informed,
        vertices=VertexEvidence(steps) if header.n_vertices else None,
    )


def _strand(
    stream: gzip.GzipFile,
    item: ItemHeader,
    header: RestorationHeader,
    disk_list: DiskList[FrameEvidence],
) -> RestoredVariant:
    log_prior = _array(stream, header.shape[:1], _REAL)
    _require(np.isfinite(log_prior).all(), "prior")
    _require(np.all(log_prior <= _ROUNDING), "prior")
    frames: Sequence[FrameEvidence]
    if item.n_frames == 1:
        frames = (_frame(stream, item, header),)
    else:
        numbers = [disk_list.add(_frame(stream, item, header)) for _ in range(item.n_frames)]
        frames = LazySequence(lambda t: disk_list[numbers[t]], len(numbers))
    return RestoredVariant(header.restored, header.log_belief, log_prior, frames)


def _frame(stream: gzip.GzipFile, item: ItemHeader, header: RestorationHeader) -> FrameEvidence:
    R, C, K = header.shape
    steps = _array(stream, (R, C, K), _STEP)
    _require(steps.min() >= -STEPS, "steps")
    if not header.placed:
        return FrameEvidence(steps)
    place, p_null = _array(stream, (R, C), _REAL), _array(stream, (C,), _REAL)
    known = place[~np.isnan(place)]
    _require(np.all((known >= 0.0) & (known <= item.n_words - 1)), "place")
    _require(np.all((p_null > 0.0) & (p_null <= 1.0)), "doubt")
    return FrameEvidence(steps, WordPosterior(place, p_null))


def _array(stream: gzip.GzipFile, shape: tuple[int, ...], kind: np.dtype[Any]) -> NDArray[Any]:
    size = int(np.prod(shape)) * kind.itemsize
    return np.frombuffer(_read(stream, size), kind).reshape(shape)


def _read(stream: gzip.GzipFile, size: int) -> bytes:
    data = stream.read(size)
    if len(data) != size:
        raise ValueError("cut short")
    return data


def _require(holds: bool | np.bool_, what: str) -> None:
    if not holds:
        raise ValueError(what)
