"""Where in a glTF file positions stand, if they can be replaced there."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray
from meshmark.errors import InputError, UsageError
from meshmark.mesh.precision import stored
from meshmark_plugins.readers.gltf.accessors import Accessors
from meshmark_plugins.readers.gltf.buffers import Buffers
from meshmark_plugins.readers.gltf.container import Container
from meshmark_plugins.readers.gltf.draco import EXTENSION as DRACO
from meshmark_plugins.readers.gltf.draft import Draft
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.geometry import POSITION
from meshmark_plugins.readers.gltf.meshopt import EXTENSIONS as MESHOPT
from meshmark_plugins.readers.gltf.meshopt import writable
from meshmark_plugins.readers.gltf.rows import BUFFERS, VIEWS, Rows

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
    for view in buffers.views:
        _require_slice(view)
        packed = view.extension(*MESHOPT)
        if packed is not None:
            _require_slice(packed)
    used: dict[int, None] = {}
    for mesh in root.objects("meshes"):
        for primitive in mesh.objects("primitives"):
            if primitive.extension(DRACO) is not None:
                _refuse(primitive.place, "is compressed by Draco, which is only read")
            used[_index(primitive, root)] = None
    places = {index: finder.place(index) for index in used}
    finder.require_apart(places)
    return places


def find_target_places(container: Container, folder: Path) -> dict[int, Place]:
    """Find those morph targets of a file that can be replaced, by their accessors.

    Each must be of one mesh and of the same positions there, and in bytes that are nothing else's.
    """
    root = container.root
    buffers = Buffers(container, folder)
    finder = _Finder(root, buffers, Accessors(root, buffers))
    users: dict[int, set[tuple[int, int]]] = {}
    for number, mesh in enumerate(root.objects("meshes")):
        for primitive in mesh.objects("primitives"):
            positions = _index(primitive, root)
            users.setdefault(positions, set()).add((-1, positions))
            for target in primitive.objects("targets"):
                if POSITION in target:
                    index = target.index(POSITION, root.objects("accessors"))
                    users.setdefault(index, set()).add((number, positions))
    found = {}
    for index, each in users.items():
        # What cannot be replaced stays.
        with suppress(UsageError, InputError):
            if len(each) == 1 and min(each)[0] >= 0:
                place = finder.place(index)
                finder.require_apart({index: place})
                found[index] = place
    return found


@dataclass(frozen=True)
class _Finder:
    root: Element
    buffers: Buffers
    accessors: Accessors

    def place(self, index: int) -> Place:
        accessor = self.accessors.elements[index]
        count = accessor.integer("count", low=1)
        dense = listed = None
        indices = np.zeros(0, dtype=np.int64)
        rows = [self._within(each) for each in self.accessors.rows(index)]
        for each in rows:
            packed = self._packed(each)
            if packed is not None and not writable(self.buffers.views[each.within[1]], packed):
                _refuse(packed.place, "is not compressed as positions are")
        if "bufferView" in accessor:
            dense = rows[0]
        if "sparse" in accessor:
            indices = self.accessors.listed(index)
            listed = rows[-1]
        if dense is None and len(np.unique(indices)) < count:
            _refuse(accessor.place, "is sparse, and what it does not list is 0 and cannot move")
        return Place(index, accessor.flag("normalized"), dense, listed, indices)

    def require_apart(self, places: dict[int, Place]) -> None:
        """Refuse positions that are in the same bytes as others, or as anything else."""
        taken: dict[tuple[str, int], NDArray[np.uint8]] = {}
        for index, place in places.items():
            for rows in filter(None, (place.dense, place.listed)):
                if rows.within not in taken:
                    taken[rows.within] = np.zeros(self._size(rows), dtype=np.uint8)
                self._require_free(index, rows, taken)
                rows.bytes.of(taken[rows.within].data)[:] = 1
        for index in range(len(self.accessors.elements)):
            # What is malformed is not read, and may be anything.
            with suppress(InputError):
                for rows in map(self._within, self.accessors.rows(index)):
                    if index not in places and rows.within in taken:
                        self._require_free(index, rows, taken)

    def _require_free(
        self, index: int, rows: Rows, taken: dict[tuple[str, int], NDArray[np.uint8]]
    ) -> None:
        if rows.bytes.of(taken[rows.within].data).any():
            _refuse(self.accessors.elements[index].place, "shares data with positions", "")

    def _size(self, rows: Rows) -> int:
        kind, number = rows.within
        data = self.buffers.view(number) if kind == VIEWS else self.buffers.data(number)
        return len(data or b"")

    def _packed(self, rows: Rows) -> Element | None:
        """Return how the view of rows is compressed; None if it is not."""
        kind, number = rows.within
        return self.buffers.views[number].extension(*MESHOPT) if kind == VIEWS else None

    def _within(self, rows: Rows) -> Rows:
        """Return rows of a view as rows of its buffer, if it is not compressed."""
        if self._packed(rows) is not None:
            return rows
        view = self.buffers.views[rows.within[1]]
        begin = rows.begin + view.integer("byteOffset", default=0)
        return replace(rows, within=(BUFFERS, view.integer("buffer")), begin=begin)


def _require_slice(holder: Element) -> None:
    """Refuse what does not say which bytes it is; it may have to move."""
    for name in ("buffer", "byteLength"):
        holder.integer(name)
    holder.integer("byteOffset", default=0)


def _index(primitive: Element, root: Element) -> int:
    return primitive.object("attributes").index(POSITION, root.objects("accessors"))


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
