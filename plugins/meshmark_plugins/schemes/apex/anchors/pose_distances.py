"""Distances from the anchors of poses, kept as they were measured when these were detected."""

from __future__ import annotations

import pickle
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import OutputError
from meshmark.files.temporary import ScratchFolder, no_room
from meshmark_plugins.schemes.apex.anchors.detect import ComponentAnchors
from meshmark_plugins.schemes.apex.anchors.proxy_distances import ProxyDistances


@dataclass(frozen=True, eq=False)
class KeptDistances:
    """Distances on one component of a pose, on its proxy if it has one.

    Parameters
    ----------
    first : int
        The component's first vertex, which tells it from others.
    root_areas : (float, float)
        Root area in which distances are given, and that of the largest component.
    anchors : (m,) int
        Vertices of the mesh that they are measured from.
    H : (m, n) float32
        The distances: a ten-millionth of them is far less than a bin.
    """

    first: int
    root_areas: tuple[float, float]
    anchors: IntArray
    H: NDArray[np.float32]

    @classmethod
    def measured(cls, found: ComponentAnchors) -> KeptDistances:
        """Measure from anchors that were detected."""
        geodesics, vertices = found.geodesics, found.component.vertices
        sources = found.maxima.vertices
        if isinstance(geodesics, ProxyDistances):
            H = geodesics.to_proxy(sources)
        else:
            H = geodesics.from_vertices(sources)
        H *= geodesics.root_area / found.root_areas[0]
        anchors = vertices[sources]
        return cls(int(vertices[0]), found.root_areas, anchors, H.astype(np.float32))

    def from_some(self, anchors: IntArray) -> FloatArray:
        """Return those from some of the anchors, (k, n) float64."""
        rows = [int(np.flatnonzero(self.anchors == vertex)[0]) for vertex in anchors]
        return self.H[rows].astype(np.float64)


@dataclass(frozen=True, eq=False)
class PoseDistances:
    """Distances of many poses, a file each.

    Pickles as a path: copies in other processes find the same files, which go with this one.
    """

    path: Path
    _folder: ScratchFolder | None = field(default=None, repr=False)

    @classmethod
    def create(cls) -> PoseDistances:
        """Make a folder for them.

        Raises
        ------
        OutputError
            If there is no place for it.
        """
        folder = ScratchFolder()
        return cls(folder.path, folder)

    def keep(self, pose: int, found: Sequence[ComponentAnchors]) -> None:
        """Measure distances from the anchors that were detected in a pose, and keep them.

        Raises
        ------
        OutputError
            If there is no room for them.
        """
        measured = [KeptDistances.measured(each) for each in found]
        try:
            self._file(pose).write_bytes(pickle.dumps(measured))
        except OSError as error:
            raise OutputError(no_room(error), source=tempfile.gettempdir()) from None

    def of(self, pose: int) -> list[KeptDistances]:
        """Return those of a pose, component by component; none where no anchor was detected."""
        file = self._file(pose)
        kept: list[KeptDistances] = pickle.loads(file.read_bytes()) if file.exists() else []
        return kept

    def _file(self, pose: int) -> Path:
        return self.path / str(pose)

    def __reduce__(self) -> tuple[type[PoseDistances], tuple[Path]]:
        return PoseDistances, (self.path,)
