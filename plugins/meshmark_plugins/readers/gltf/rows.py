"""Where in the bytes of a file numbers stand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.errors import InputError

BUFFERS, VIEWS = "buffers", "bufferViews"
Buffer = bytes | bytearray | memoryview


@dataclass(frozen=True)
class Rows:
    """Where rows of numbers stand.

    Parameters
    ----------
    within : (str, int)
        A buffer; or a view, once it is decompressed.
    begin, stride : int
        In bytes.
    count, width : int
        Rows, and numbers in each.
    dtype : np.dtype
    """

    within: tuple[str, int]
    begin: int
    stride: int
    count: int
    width: int
    dtype: np.dtype[Any]

    @property
    def end(self) -> int:
        """Where they end."""
        return self.begin + (self.count - 1) * self.stride + self.width * self.dtype.itemsize

    def of(self, data: Buffer) -> NDArray[Any]:
        """Return them as a view of the bytes they are within, (count, width).

        Raises
        ------
        InputError
            If they reach beyond.
        """
        if self.end > len(data):
            kind, number = self.within
            raise InputError(f"{kind}[{number}]: ends at byte {len(data)}, not {self.end}")
        strides = (self.stride, self.dtype.itemsize)
        return np.ndarray((self.count, self.width), self.dtype, data, self.begin, strides)

    @property
    def bytes(self) -> Rows:
        """The same as rows of bytes."""
        return replace(self, width=self.width * self.dtype.itemsize, dtype=np.dtype(np.uint8))
