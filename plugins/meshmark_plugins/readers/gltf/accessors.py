"""Accessors: typed arrays in views of buffers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import IntArray
from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.buffers import Buffers
from meshmark_plugins.readers.gltf.element import LARGEST, Element
from meshmark_plugins.readers.gltf.rows import VIEWS, Rows

TYPES: dict[int, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
LARGEST_OF = {dtype: float(np.iinfo(dtype).max) for dtype in TYPES.values() if dtype.kind != "f"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
KINDS = tuple(WIDTHS)


class Accessors:
    """The accessors of a document.

    Real numbers are handed out as copies. Integers, and numbers as they are stored, may be where
    they stand in the file: whoever keeps them copies them, or keeps all of it.

    Parameters
    ----------
    root : Element
        The document.
    buffers : Buffers
        Its bytes.
    """

    def __init__(self, root: Element, buffers: Buffers) -> None:
        self.elements = root.objects("accessors")
        self._buffers = buffers

    def count(self, index: int) -> int:
        """Return how many elements an accessor says it has."""
        return self.elements[index].integer("count", low=1)

    def width(self, index: int) -> int:
        """Return how many numbers an element of an accessor has."""
        return WIDTHS[self.elements[index].one_of("type", KINDS)]

    def values(self, index: int, width: int, *, stored: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return numbers as they are stored, (N, width); see `numbers`."""
        return self._values(self.elements[index], width, None, stored)

    def numbers(
        self,
        index: int,
        width: int,
        *,
        count: int | None = None,
        stored: NDArray[Any] | None = None,
    ) -> NDArray[np.floating]:
        """Return real numbers.

        Parameters
        ----------
        width : int
            Numbers of an element: 3 for vectors, 16 for matrices.
        count : int, optional
            How many elements there must be.
        stored : (N, width) array, optional
            What a decoder has found in place of the accessor's own data.

        Returns
        -------
        (N, width) float32 or float64
            Finite; float64 where integers stand for numbers within [-1, 1].
        """
        accessor = self.elements[index]
        return _real([accessor], [self._values(accessor, width, count, stored)])

    def joined(self, indices: Sequence[int], width: int, count: int) -> NDArray[np.floating]:
        """Return real numbers of accessors of the same count behind each other; see `numbers`."""
        chosen = [self.elements[index] for index in indices]
        return _real(chosen, [self._values(each, width, count) for each in chosen])

    def integers(
        self,
        index: int,
        width: int,
        *,
        count: int | None = None,
        stored: NDArray[Any] | None = None,
    ) -> IntArray:
        """Return integers that are not negative, (N, width); see `numbers`."""
        accessor = self.elements[index]
        values = self._values(accessor, width, count, stored)
        if values.dtype.kind != "u":
            accessor.fail("componentType", "is not of unsigned integers")
        return values

    def rows(self, index: int) -> list[Rows]:
        """Return where the numbers of an accessor stand: in its view, and where it is sparse."""
        accessor = self.elements[index]
        dtype, width = stored_type(accessor), self.width(index)
        found = []
        if "bufferView" in accessor:
            found.append(self._rows(accessor, dtype, accessor.integer("count", low=1), width))
        if "sparse" in accessor:
            sparse = accessor.object("sparse")
            count = sparse.integer("count", low=1)
            found.append(self._rows(sparse.object("values"), dtype, count, width))
        return found

    def _rows(self, holder: Element, dtype: np.dtype[Any], count: int, width: int) -> Rows:
        number = holder.index("bufferView", self._buffers.views)
        stride = self._buffers.stride(number) or width * dtype.itemsize
        begin = holder.integer("byteOffset", default=0)
        return Rows((VIEWS, number), begin, stride, count, width, dtype)

    def _values(
        self,
        accessor: Element,
        width: int,
        count: int | None = None,
        stored: NDArray[Any] | None = None,
    ) -> NDArray[Any]:
        """Return numbers as they are stored, (N, width)."""
        claimed = accessor.integer("count", low=1)
        if count is not None and claimed != count:
            accessor.fail("count", f"is {claimed}, not {count}")
        if WIDTHS[accessor.one_of("type", KINDS)] != width:
            accessor.fail("type", f"is {accessor.text('type')}, not of {width} numbers")
        if stored is not None:
            if stored.shape != (claimed, width):
                found = " x ".join(map(str, stored.shape))
                raise InputError(f"{accessor.place}: {found} numbers were compressed")
            return stored
        dtype = stored_type(accessor)
        sparse = accessor.object("sparse") if "sparse" in accessor.members else None
        if "bufferView" in accessor.members:
            values = self._dense(accessor, dtype, claimed, width)
        else:
            # Nothing but the number of vertices, or what is listed, bounds what is allocated.
            listed = 0 if sparse is None else sparse.integer("count")
            if count is None and listed < claimed:
                accessor.fail("bufferView", "is missing")
            values = None
        if sparse is not None:
            return self._with_sparse(sparse, dtype, claimed, width, values)
        return np.zeros((claimed, width), dtype=dtype) if values is None else values

    def _dense(self, holder: Element, dtype: np.dtype[Any], count: int, width: int) -> NDArray[Any]:
        """Return the rows that a view holds from an offset on, where they stand."""
        number = holder.index("bufferView", self._buffers.views)
        view, size = self._buffers.view(number), width * dtype.itemsize
        stride = self._buffers.stride(number) or size
        begin = holder.integer("byteOffset", default=0)
        end = begin + (count - 1) * stride + size
        if stride < size:
            raise InputError(
                f"{holder.place}: its elements have {size} bytes, {stride} bytes apart"
            )
        if end > len(view):
            raise InputError(f"{holder.place}: ends at byte {end} of a view of {len(view)} bytes")
        return np.ndarray((count, width), dtype, view, begin, (stride, dtype.itemsize))

    def _with_sparse(
        self,
        sparse: Element,
        dtype: np.dtype[Any],
        count: int,
        width: int,
        values: NDArray[Any] | None,
    ) -> NDArray[Any]:
        """Put in the elements that are listed one by one."""
        indices = self._listed(sparse, count)
        replaced = self._dense(sparse.object("values"), dtype, len(indices), width)
        values = np.zeros((count, width), dtype=dtype) if values is None else values.copy()
        values[indices] = replaced
        return values

    def listed(self, index: int) -> IntArray:
        """Return which elements of a sparse accessor are listed one by one, (L,)."""
        accessor = self.elements[index]
        return self._listed(accessor.object("sparse"), accessor.integer("count", low=1))

    def _listed(self, sparse: Element, count: int) -> IntArray:
        listed = sparse.integer("count", low=1, high=count)
        where = sparse.object("indices")
        kind = stored_type(where)
        if kind.kind != "u":
            where.fail("componentType", "is not of unsigned integers")
        indices = self._dense(where, kind, listed, 1)[:, 0]
        if indices.max() >= count:
            raise InputError(f"{where.place}: {indices.max()} is out of range for {count} elements")
        return indices


def _real(accessors: Sequence[Element], stored: Sequence[NDArray[Any]]) -> NDArray[np.floating]:
    """Return the real numbers of accessors of the same count behind each other, all finite."""
    pairs = list(zip(accessors, stored, strict=True))
    kinds = {(each.dtype, _is_normalized(accessor, each)) for accessor, each in pairs}
    if len(kinds) > 1:
        return np.concatenate([_real([accessor], [each]) for accessor, each in pairs])
    [(dtype, normalized)] = kinds
    values = np.concatenate(stored)
    if dtype.kind == "f":
        finite = np.isfinite(values)
        if not finite.all():
            wrong, row = divmod(int(np.argmin(finite.all(axis=1))), len(stored[0]))
            raise InputError(f"{accessors[wrong].place}: element {row} is not finite")
        return values
    if not normalized:
        # Single precision holds integers of two bytes.
        return values.astype(np.float32 if values.itemsize < 4 else np.float64)
    found = values / LARGEST_OF[dtype]
    # The least number of a signed type stands for -1, as its neighbour does.
    return found if dtype.kind == "u" else np.maximum(found, -1.0, out=found)


def _is_normalized(accessor: Element, stored: NDArray[Any]) -> bool:
    """Tell whether integers stand for numbers within [-1, 1]."""
    return stored.dtype.kind != "f" and accessor.flag("normalized")


def stored_type(element: Element) -> np.dtype[Any]:
    """Return the type of the numbers of an accessor, or of what is sparse in one."""
    number = element.integer("componentType", high=LARGEST)
    if number not in TYPES:
        element.fail("componentType", f"is {number}, which is no type of glTF")
    return TYPES[number]
