"""What follows from triangles alone, worked out once and kept as long as they are."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import wraps
from typing import Any, TypeVar

from numpy.typing import NDArray

from meshmark.arrays import IntArray

Result = TypeVar("Result")
Array = TypeVar("Array", bound=NDArray[Any])


def remembered(function: Callable[[IntArray], Result]) -> Callable[[IntArray], Result]:
    """Remember what a function says of an array that cannot be written to, until that is gone.

    The triangles of a `Topology` are such, and many frames share them. Of other arrays nothing is
    remembered: they may be changed.
    """
    known: dict[int, tuple[weakref.ref[IntArray], Result]] = {}

    @wraps(function)
    def call(array: IntArray) -> Result:
        if array.flags.writeable:
            return function(array)
        key = id(array)
        found = known.get(key)
        if found is None:
            found = weakref.ref(array, lambda _: known.pop(key, None)), function(array)
            known[key] = found
        return found[1]

    return call


def read_only(array: Array) -> Array:
    """Return an array that cannot be written to, of the same values in the same place."""
    view = array.view()
    view.setflags(write=False)
    return view
