"""Alters files of a store: rows under a valid seal, columns and how they are packed, and bytes."""

from __future__ import annotations

from io import BytesIO
from random import Random
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from .evidence import altered_evidence
from .texts import altered_bytes

EVIDENCE = "evidence"
# At the end of every file: the length of the words about its columns, and a name.
ENDING = 8
# What nobody would write who has no ill intent, or another program.
PACKED = (
    {},
    {"compression": "gzip"},
    {"compression": "zstd"},
    {"use_dictionary": True},
    {"row_group_size": 1},
    {"data_page_version": "2.0"},
    {"column_encoding": {EVIDENCE: "DELTA_LENGTH_BYTE_ARRAY"}},
)
OTHERWISE: tuple[Any, ...] = (None, 0, -1.5, "", b"", [], ["x"], {"a": 1}, "x" * 1000)


def altered_store(data: bytes, rng: Random) -> bytes:
    """Alter a file of a store."""
    match rng.randrange(5):
        case 0:
            return altered_bytes(data, rng)
        case 1:
            return _with_another_footer(data, rng)
    columns = parquet.read_table(BytesIO(data), use_threads=False).to_pydict()
    if rng.random() < 0.8:
        columns[EVIDENCE] = [altered_evidence(columns[EVIDENCE][0], rng)]
    else:
        # Each row that is wrong would be told of by itself.
        times = rng.choice((0, 2, 3))
        columns = {name: values * times for name, values in columns.items()}
    if rng.random() < 0.3:
        n_rows = len(columns[EVIDENCE])
        columns[rng.choice(list(columns))] = [rng.choice(OTHERWISE)] * n_rows
    if rng.random() < 0.1:
        del columns[rng.choice(list(columns))]
    table = pa.table(columns)
    return _written(table, rng.choice(PACKED) if rng.random() < 0.4 else {})


def _with_another_footer(data: bytes, rng: Random) -> bytes:
    length = int.from_bytes(data[-ENDING : -ENDING + 4], "little")
    start = len(data) - ENDING - length
    footer = altered_bytes(data[start:-ENDING], rng)
    return data[:start] + footer + len(footer).to_bytes(4, "little") + data[-4:]


def _written(table: pa.Table, packed: dict[str, Any]) -> bytes:
    plain = {"compression": "none", "use_dictionary": False, "write_statistics": False}
    written = BytesIO()
    try:
        parquet.write_table(table, written, **{**plain, **packed})
    except (pa.ArrowException, ValueError, TypeError, OSError):
        # Not every type of column can be packed in every way.
        written = BytesIO()
        parquet.write_table(table, written)
    return written.getvalue()
