"""Frames that a process of its own has read, as arrays in a temporary file."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import MeshmarkError
from meshmark.mesh.animation import Frame
from meshmark.mesh.skinning import Skinning
from meshmark.mesh.topology import Topology

FLOAT, INT = np.dtype("<f8"), np.dtype("<i8")
ITEM = 8  # bytes of either

# What the columns of a table of frames, and of one of topologies, say.
POINTS_AT, N_POINTS, TOPOLOGY = range(3)
COUNTS_AT, N_COUNTS, INDICES_AT, N_INDICES = range(4)


# Where the rest pose, the joints and the weights of a skinning begin, points, and joints of each.
Places = tuple[int, int, int, int, int]


class ArrayWriter:
    """Writes arrays behind each other; an array is found again by where it begins."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def add(self, array: NDArray[Any]) -> int:
        """Write an array, and return where it begins, in bytes."""
        begin = self._file.tell()
        dtype = FLOAT if array.dtype.kind == "f" else INT
        self._file.write(np.ascontiguousarray(array, dtype=dtype).tobytes())
        return begin


def read_floats(path: Path, begin: int, *shape: int) -> FloatArray:
    """Read an array of numbers that `ArrayWriter` wrote."""
    return _read(path, FLOAT, begin, shape)


def read_integers(path: Path, begin: int, *shape: int) -> IntArray:
    """Read an array of integers that `ArrayWriter` wrote."""
    return _read(path, INT, begin, shape)


def _read(path: Path, dtype: np.dtype[Any], begin: int, shape: tuple[int, ...]) -> NDArray[Any]:
    require_within(path, np.array([begin]), np.array([np.prod(shape, dtype=np.float64)]))
    found = np.fromfile(path, dtype=dtype, count=int(np.prod(shape)), offset=begin)
    return found.reshape(shape)


def require_within(path: Path, begins: NDArray[Any], counts: NDArray[Any]) -> None:
    """Refuse arrays that do not lie within a file.

    Raises
    ------
    ValueError
        If one does not: whoever says so is not to be believed.
    """
    size = path.stat().st_size
    ends = begins.astype(np.float64) + ITEM * counts.astype(np.float64)
    if (begins < 0).any() or (counts < 0).any() or (ends > size).any():
        raise ValueError("an array outside its file")


@dataclass(frozen=True, eq=False)
class IsolatedFrames:
    """Frames of a mesh that were all read before, in a process of its own.

    Pickles as where they lie, for worker processes; the file lives as long as the original.

    Parameters
    ----------
    path : Path
        The file of arrays.
    times : (T,) float64
        Time codes.
    table : (T, 3) int64
        Where the points of each frame begin, how many there are, and the number of the topology.
    topologies : (K, 4) int64
        Where counts begin, how many there are, and the same of indices.
    errors : mapping of int to MeshmarkError
        Why a frame cannot be read.
    skinned : Places or None
        Where it says how joints move the points.
    """

    path: Path
    times: FloatArray
    table: IntArray
    topologies: IntArray
    errors: Mapping[int, MeshmarkError]
    skinned: Places | None = None
    _owner: object = field(default=None, repr=False)

    def __post_init__(self) -> None:
        readable = np.delete(self.table, list(self.errors), axis=0)
        require_within(self.path, readable[:, POINTS_AT], 3 * readable[:, N_POINTS])
        for at, n in ((COUNTS_AT, N_COUNTS), (INDICES_AT, N_INDICES)):
            require_within(self.path, self.topologies[:, at], self.topologies[:, n])
        numbers = readable[:, TOPOLOGY]
        if ((numbers < 0) | (numbers >= len(self.topologies))).any():
            raise ValueError("a frame without topology")
        if self.skinned is not None:
            *begins, n_points, n = self.skinned
            counts = n_points * np.array([3.0, n, n])
            require_within(self.path, np.array(begins), counts)
            if (readable[:, N_POINTS] != n_points).any():
                raise ValueError("joints of other points")

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "_owner": None}

    def frame(self, index: int) -> Frame:
        """Return frame `index`, or raise what reading it raised."""
        error = self.errors.get(index)
        if error is not None:
            raise copy(error)
        begin, n_points, number = self.table[index].tolist()
        points = read_floats(self.path, begin, n_points, 3)
        topology = _topology(self.path, *self.topologies[number].tolist(), n_points)
        return Frame(float(self.times[index]), points, topology)

    def skinning(self) -> Skinning | None:
        """Return how joints move the points, if it was known."""
        if self.skinned is None:
            return None
        rest, joints, weights, n_points, n = self.skinned
        return Skinning.fit(
            read_floats(self.path, rest, n_points, 3),
            read_integers(self.path, joints, n_points, n),
            read_floats(self.path, weights, n_points, n),
        )


# Frames of constant topology share one in each process.
@lru_cache(maxsize=4)
def _topology(
    path: Path, counts_at: int, n_counts: int, indices_at: int, n_indices: int, n_points: int
) -> Topology:
    counts = read_integers(path, counts_at, n_counts)
    return Topology(counts, read_integers(path, indices_at, n_indices), n_points)
