"""Where in a glTF file positions stand, if they can be replaced there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray
from meshmark.errors import UsageError
from meshmark.mesh.precision import stored
from meshmark_plugins.readers.gltf.accessors import Accessors, stored_type
from meshmark_plugins.readers.gltf.buffers import MESHOPT, Buffers
from meshmark_plugins.readers.gltf.container import Container
from meshmark_plugins.readers.gltf.draco import EXTENSION as DRACO
from meshmark_plugins.readers.gltf.draft import BUFFERS, VIEWS, Draft, Rows
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.geometry import POSITION
from meshmark_plugins.readers.gltf.meshopt import writable

AXES = 3
PLAIN = "--uncompress writes it plain, and "


@dataclass(frozen=True, eq=False)
class Place:
    """Where the positions of an accessor stand.

    Parameters
    ----------
    accessor : int
    normalized : bool
        Whether integers stand for numbers within [-1, 1].
    dense : Rows or None
        All of them; None if they are 0 but for those that are listed.
    listed : Rows or None
        Those that are listed one by one, in the place of what is dense.
    indices : (L,) int
        Which ones are listed.
    """

    accessor: int
    normalized: bool
    dense: Rows | None
    listed: Rows | None
    indices: NDArray[Any]

    def move(self, draft: Draft, move: FloatArray, output: Path) -> dict[str, list[Any]]:
        """Move positions by (N, 3), and return their bounds as an accessor has them.

        Raises
        ------
        OutputError
            If one is then beyond what float32 holds. Integers stop at their least and largest.
        """
        rows = self.dense or self.listed
        assert rows is not None
        points = np.zeros((len(move), AXES), dtype=rows.dtype)
        if self.dense is not None:
            points = draft.of(self.dense).copy()
        if self.listed is not None:
            points[self.indices] = draft.of(self.listed)
        points = _moved(points, move, self.normalized, output)
        if self.dense is not None:
            draft.of(self.dense)[:] = points
        if self.listed is not None:
            draft.of(self.listed)[:] = points[self.indices]
        return {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}


def find_places(container: Container, folder: Path) -> dict[int, Place]:
    """Find the positions of all meshes of a file that `read` accepts, by their accessors.

    Raises
    ------
    UsageError
        If they cannot be replaced: compressed by Draco, sparse over nothing, or the same bytes for
        several accessors.
    InputError
        If a buffer, or what is compressed in it, cannot be read.
    """
    root = container.root
    buffers = Buffers(container, folder)
    finder = _Finder(root, buffers, Accessors(root, buffers))
    for index in range(len(root.objects(BUFFERS))):
        buffers.data(index)
    used: dict[int, None] = {}
    for mesh in root.objects("meshes"):
        for primitive in mesh.objects("primitives"):
            if primitive.extension(DRACO) is not None:
                _refuse(primitive.place, "is compressed by Draco, which is only read")
            used[_index(primitive, root)] = None
    places = {index: finder.place(index) for index in used}
    _require_apart(places)
    return places


@dataclass(frozen=True)
class _Finder:
    root: Element
    buffers: Buffers
    accessors: Accessors

    def place(self, index: int) -> Place:
        accessor = self.accessors.elements[index]
        dtype = stored_type(accessor)
        count = accessor.integer("count", low=1)
        dense = listed = None
        indices = np.zeros(0, dtype=np.int64)
        if "bufferView" in accessor:
            dense = self._rows(accessor, dtype, count)
        if "sparse" in accessor:
            sparse = accessor.object("sparse")
            indices = self.accessors.listed(index)
            listed = self._rows(sparse.object("values"), dtype, len(indices))
        if dense is None and len(np.unique(indices)) < count:
            _refuse(accessor.place, "is sparse, and what it does not list is 0 and cannot move")
        return Place(index, accessor.flag("normalized"), dense, listed, indices)

    def _rows(self, holder: Element, dtype: np.dtype[Any], count: int) -> Rows:
        number = holder.index("bufferView", self.buffers.views)
        view, size = self.buffers.views[number], AXES * dtype.itemsize
        begin = holder.integer("byteOffset", default=0)
        stride = self.buffers.stride(number) or size
        within = (VIEWS, number)
        packed = view.extension(*MESHOPT)
        if packed is not None and not writable(packed):
            _refuse(view.place, "is not compressed as positions are")
        if packed is None:
            within = (BUFFERS, view.integer("buffer"))
            begin += view.integer("byteOffset", default=0)
        self.buffers.view(number)
        return Rows(within, begin, stride, count, AXES, dtype)


def _index(primitive: Element, root: Element) -> int:
    return primitive.object("attributes").index(POSITION, root.objects("accessors"))


def _require_apart(places: dict[int, Place]) -> None:
    """Refuse positions that are in the same bytes as others."""
    by_begin = sorted(_parts(places), key=lambda part: (part[1].within, part[1].begin))
    for (one, before), (two, after) in pairwise(by_begin):
        if after.within == before.within and after.begin < before.end:
            _refuse(f"accessors[{two}]", f"shares data with accessors[{one}]", "")


def _parts(places: dict[int, Place]) -> Iterator[tuple[int, Rows]]:
    for index, place in places.items():
        for rows in (place.dense, place.listed):
            if rows is not None:
                yield index, rows


def _moved(points: NDArray[Any], move: FloatArray, normalized: bool, output: Path) -> NDArray[Any]:
    if points.dtype.kind == "f":
        return stored(points + move, points.dtype, source=output)
    info = np.iinfo(points.dtype)
    most = info.max
    # The least number of a signed type stands for -1, as its neighbour does.
    least = max(info.min, -most) if normalized else info.min
    wanted = np.maximum(points, least) + move * (most if normalized else 1)
    return np.clip(np.rint(wanted), least, most).astype(points.dtype)


def _refuse(place: str, reason: str, hint: str = PLAIN) -> NoReturn:
    raise UsageError(f"{place} {reason}; {hint}a .usdc always can be written")
