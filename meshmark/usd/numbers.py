"""Every array of numbers in a layer, in whatever form: shown to whoever looks, and replaced."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Vt

from meshmark.arrays import FloatArray, IntArray
from meshmark.usd.layers import set_field, set_value, value_at
from meshmark.usd.metadata import fields_of, paths_of

Numbers = NDArray[Any]
Number = TypeVar("Number", np.float64, np.int64)

# Integers that say which, not where.
WHICH = re.compile(
    r"faceVertex(Counts|Indices)|curveVertexCounts|.*[iI]ndices|.*:indices|ids|protoIndices"
)
# Bytes and integers may be floating-point numbers in disguise.
DISGUISES = ("<f4", "<f8", "<f2")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
MIN_NUMBERS = 96
MAX_STACK = 4096


@dataclass(frozen=True)
class Place:
    """Where an array is.

    Parameters
    ----------
    path : str
        The attribute; or the prim or property, and the key of its metadata.
    owner : str
        The prim.
    time : float
        The time sample; NaN for a default, and for metadata.
    indices : (I,) int, optional
        Row for each vertex or corner, where the array is indexed.
    thorough : bool
        Whether to look for what takes long to find.
    """

    path: str
    owner: str
    time: float = np.nan
    indices: IntArray | None = None
    thorough: bool = True


# Given an array and its place, returns the array that is to be there, and the names of what was
# found in it; without any, the array stays.
Look = Callable[[Numbers, Place], tuple[Numbers, set[str]]]
# Where something was found, and its name.
Found = tuple[str, str]


def rewrite_numbers(layer: Sdf.Layer, look: Look) -> set[Found]:
    """Let somebody look at every array of numbers in a layer, and put what they give instead.

    Arrays in attributes, their time samples and metadata; texts that list numbers, too.
    """
    found: set[Found] = set()
    for path in paths_of(layer):
        attribute = layer.GetAttributeAtPath(path) if path.IsPropertyPath() else None
        if attribute is not None:
            found |= _rewrite_attribute(layer, attribute, look)
        found |= _rewrite_metadata(layer, path, look)
    return found


def _rewrite_attribute(layer: Sdf.Layer, attribute: Sdf.AttributeSpec, look: Look) -> set[Found]:
    path, owner = attribute.path, str(attribute.path.GetPrimPath())
    if WHICH.fullmatch(attribute.name) and attribute.typeName.type.typeName.startswith("VtArray<i"):
        return set()
    samples = layer.ListTimeSamplesForPath(path)
    indices = _as_indices(value_at(layer, Sdf.Path(f"{path}:indices"), np.nan))

    def look_at(time: float, thorough: bool) -> tuple[Any, set[str]]:
        place = Place(str(path), owner, time, indices, thorough)
        return _rewritten(value_at(layer, path, time), place, look)

    # What takes long to find is looked for in three samples: they tell whether it is worth it.
    probes = {samples[0], samples[len(samples) // 2], samples[-1]} if samples else set()
    thorough = len(samples) <= len(probes) or any(look_at(time, True)[1] for time in probes)
    found: set[Found] = set()
    for time in (np.nan, *samples):
        value, names = look_at(time, thorough or bool(np.isnan(time)))
        if names:
            set_value(layer, path, time, value)
            found |= {(str(path), name) for name in names}
    return found


def _rewrite_metadata(layer: Sdf.Layer, path: Sdf.Path, look: Look) -> set[Found]:
    spec = layer.GetObjectAtPath(path)
    if spec is None:
        return set()
    found: set[Found] = set()

    def rewritten(value: Any, key: str) -> Any:
        if isinstance(value, Mapping):
            return {name: rewritten(each, f"{key}:{name}") for name, each in value.items()}
        place = Place(f"{path} {key}", str(path.GetPrimPath()))
        new, names = _rewritten(value, place, look)
        found.update((place.path, name) for name in names)
        return new

    for field, value in list(fields_of(spec)):
        before = len(found)
        new = rewritten(value, field)
        if len(found) > before:
            set_field(spec, field, new)
    return found


def _rewritten(value: Any, place: Place, look: Look) -> tuple[Any, set[str]]:
    if isinstance(value, str):
        return _rewritten_text(value, place, look)
    if isinstance(value, Vt.StringArray | Vt.TokenArray):
        text, names = _rewritten_text("\0".join(value), place, look)
        return (type(value)(text.split("\0")), names) if names else (value, names)
    numbers = as_numbers(value)
    if numbers is None:
        return value, set()
    new, names = look(numbers, place)
    return (type(value).FromNumpy(np.ascontiguousarray(new)), names) if names else (value, names)


def _rewritten_text(text: str, place: Place, look: Look) -> tuple[str, set[str]]:
    if len(text) < 2 * MIN_NUMBERS:
        return text, set()
    numbers = np.array([float(number) for number in NUMBER.findall(text)])
    if len(numbers) < MIN_NUMBERS:
        return text, set()
    new, names = look(numbers, place)
    if not names:
        return text, names
    put = iter(new.tolist())
    return NUMBER.sub(lambda _: f"{next(put):.9g}", text), names


def as_numbers(value: Any) -> Numbers | None:
    """See a value as numbers, if it is an array of them."""
    if not hasattr(type(value), "FromNumpy"):
        return None
    array = np.asarray(value)
    return array if array.dtype.kind in "fiu" and array.size else None


def _as_indices(value: Any) -> IntArray | None:
    indices = as_numbers(value)
    if indices is None or indices.ndim != 1 or indices.dtype.kind not in "iu":
        return None
    return indices


# Returns an array as it was, with numbers (M, d) float64 in it.
Back = Callable[[FloatArray], Numbers]


def readings(array: Numbers) -> Iterator[tuple[Numbers, Back]]:
    """Read an array as a table (M, d) of numbers, and say how to write others back."""
    if array.size == 0:
        return

    def reading(numbers: Numbers) -> tuple[Numbers, Back]:
        table = numbers.reshape(len(numbers), -1)

        def back(new: FloatArray) -> Numbers:
            result = table.copy()
            changed = new != table.astype(np.float64)
            result[changed] = _cast(new[changed], table.dtype)
            return result.reshape(-1).view(array.dtype).reshape(array.shape)

        return table, back

    yield reading(array)
    if array.dtype.kind not in "iu":
        return
    raw = np.ascontiguousarray(array).reshape(-1)
    for kind in DISGUISES:
        dtype = np.dtype(kind)
        if raw.nbytes % dtype.itemsize == 0 and dtype.itemsize >= array.dtype.itemsize:
            yield reading(raw.view(dtype))


def _cast(values: FloatArray, dtype: np.dtype[Any]) -> Numbers:
    whole = dtype.kind in "iu"
    limits = np.iinfo(dtype) if whole else np.finfo(dtype)
    rounded = np.rint(values) if whole else values
    return rounded.clip(limits.min, limits.max).astype(dtype)


def views(
    numbers: NDArray[Number], vertices: IntArray, sample_rows: IntArray, indices: IntArray | None
) -> Iterator[tuple[NDArray[Number], IntArray, IntArray]]:
    """See numbers (M, d) as rows, one for each entry of `vertices`, in every way they could be.

    Yields
    ------
    view : (R, c) numbers
        Writes through to the numbers.
    vertices : (R,) int
        Vertex of each row.
    sample_rows : (S,) int
        Row of each sampled vertex.
    """
    M, d = numbers.shape
    R = len(vertices)
    if indices is not None and len(indices) == R and M and 0 <= indices.min() <= indices.max() < M:
        rows, first = np.unique(indices, return_index=True)
        if np.array_equal(rows, np.arange(M)):
            yield numbers, vertices[first], indices[sample_rows]
            return
    if R == 0 or M % R or M == 0 or M // R > MAX_STACK:
        return
    k = M // R
    for each in numbers.reshape(k, R, d):
        yield each, vertices, sample_rows
    if k > 1 and k * d <= MAX_STACK:
        yield numbers.reshape(R, k * d), vertices, sample_rows


def clouds(numbers: FloatArray) -> Iterator[FloatArray]:
    """See numbers (M, d) as points (K, 3), in every way they could be; writes go through."""
    M, d = numbers.shape
    if d in (3, 4):
        yield numbers[:, :3]
    elif d == 16:
        yield numbers[:, 12:15]
    elif d == 1 and numbers.size >= MIN_NUMBERS:
        if M % 3 == 0:
            yield numbers.reshape(-1, 3)
            yield numbers.reshape(3, -1).T
        if M % 4 == 0:
            yield numbers.reshape(-1, 4)[:, :3]
