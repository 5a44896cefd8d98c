"""Displacements kept on disk: an animation being marked never has to fit into memory."""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import OutputError
from meshmark.files.temporary import ScratchFolder, no_room
from meshmark.mesh.animation import Frame, FrameSource

SINGLE, DOUBLE = "<f4", "<f8"


@dataclass(frozen=True)
class DisplacedFrames:
    """Frames of another source, with displacements added that lie in a scratch file.

    Pickles as a path, so that worker processes see the same displacements; the file lives
    as long as the `ScratchFile` that made it.
    """

    base: FrameSource
    scratch: ScratchFile

    def frame(self, index: int) -> Frame:
        """Read frame `index` of the base and add its displacement."""
        frame = self.base.frame(index)
        return frame.moved(frame.points + self.scratch.read(index))


@dataclass(frozen=True)
class ScratchFile:
    """A temporary file of T arrays (N, 3), or (N, width), float64 outside.

    A displacement is a small correction: in float32 it is exact to a ten-millionth of itself,
    far below the rounding of the float32 positions it ends up in.

    Parameters
    ----------
    path : Path
        The file; copies in other processes find it by this.
    n_points : int
        N.
    dtype : str
        Type on disk: float32, or float64 for what more is computed with.
    width : int
        Numbers for each point.
    """

    path: Path
    n_points: int
    dtype: str = SINGLE
    width: int = 3
    _folder: ScratchFolder | None = field(default=None, compare=False, repr=False)

    @classmethod
    def create(
        cls, n_frames: int, n_points: int, dtype: str = SINGLE, width: int = 3
    ) -> ScratchFile:
        """Make a file of zeros, deleted when the returned object (not its copies) goes away.

        Parameters
        ----------
        n_frames, n_points : int
            T and N.
        dtype : str
            `SINGLE` or `DOUBLE`.
        width : int
            Numbers for each point.

        Raises
        ------
        OutputError
            If there is no room for it: better now than after hours of work.
        """
        folder = ScratchFolder()
        scratch = cls(folder.path / "displacements", n_points, dtype, width, folder)
        try:
            with scratch.path.open("xb") as file:
                _reserve(file.fileno(), n_frames * scratch._stride)
        except OSError as error:
            raise OutputError(no_room(error), source=tempfile.gettempdir()) from None
        return scratch

    def write(self, index: int, displacement: FloatArray) -> None:
        """Store the displacement of frame `index`, (N, width)."""
        data = np.ascontiguousarray(displacement, dtype=self.dtype)
        with self.path.open("r+b") as file:
            file.seek(index * self._stride)
            file.write(data.tobytes())

    def read(self, index: int) -> FloatArray:
        """Read the displacement of frame `index`, (N, width) float64."""
        count = self.width * self.n_points
        data = np.fromfile(self.path, dtype=self.dtype, count=count, offset=index * self._stride)
        return data.reshape(-1, self.width).astype(np.float64)

    @property
    def _stride(self) -> int:
        return self.width * np.dtype(self.dtype).itemsize * self.n_points

    def __reduce__(self) -> tuple[object, ...]:
        return (ScratchFile, (self.path, self.n_points, self.dtype, self.width))


def _reserve(handle: int, size: int) -> None:
    """Give a file its size, and the room for it where the system can promise that."""
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(handle, 0, max(size, 1))
    else:
        os.ftruncate(handle, size)
