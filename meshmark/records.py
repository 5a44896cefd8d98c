"""Arrays in a zip file, laid out as `numpy.savez` does, of which one record at a time is held."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import DTypeLike, NDArray


def write_records(
    archive: zipfile.ZipFile,
    name: str,
    records: Iterable[NDArray[Any]],
    shape: tuple[int, ...],
    dtype: DTypeLike,
) -> None:
    """Write an array of `shape` (T, ...), given as its T records, as `name`.npy."""
    kind = np.dtype(dtype).newbyteorder("<")
    with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
        header = {"descr": npy.dtype_to_descr(kind), "fortran_order": False, "shape": shape}
        npy.write_array_header_1_0(file, header)
        for record in records:
            file.write(record.astype(kind, order="C", copy=False).tobytes())


def read_records(archive: zipfile.ZipFile, name: str, dtype: DTypeLike) -> Iterator[NDArray[Any]]:
    """Read the records of array `name`.npy, which is to be of type `dtype`.

    Raises
    ------
    KeyError
        If there is no such array.
    ValueError
        If it is of another type, or cut short.
    """
    kind = np.dtype(dtype).newbyteorder("<")
    with archive.open(f"{name}.npy") as file:
        if npy.read_magic(file) != (1, 0):
            raise ValueError("version")
        shape, is_fortran, given = npy.read_array_header_1_0(file)
        if is_fortran or given != kind or not shape:
            raise ValueError("layout")
        size = int(np.prod(shape[1:])) * kind.itemsize
        for _ in range(shape[0]):
            # A record that is cut short does not fill its shape.
            yield np.frombuffer(file.read(size), kind).reshape(shape[1:])
        # The end is where checksums are compared.
        if file.read(1):
            raise ValueError("too long")
