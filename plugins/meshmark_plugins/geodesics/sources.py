"""The look every solver takes at the sources it is asked about."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from meshmark.arrays import IntArray
from meshmark.errors import UsageError


def source_indices(sources: ArrayLike, n_points: int) -> IntArray:
    """Return sources as (S,) int64.

    Raises
    ------
    UsageError
        If they are not a list of vertex indices in range.
    """
    indices = np.asarray(sources)
    if indices.size == 0:
        return np.zeros(0, dtype=np.int64)
    if indices.ndim != 1 or indices.dtype.kind not in "iu":
        raise UsageError(
            f"sources must be a list of vertex indices, not {indices.dtype} {indices.shape}"
        )
    low, high = int(indices.min()), int(indices.max())
    if low < 0 or high >= n_points:
        raise UsageError(
            f"source vertex {low if low < 0 else high} is out of range for {n_points} points"
        )
    return indices.astype(np.int64)
