"""Where in a binary glTF file positions stand, if they can be replaced there."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from meshmark.errors import UsageError
from meshmark_plugins.readers.gltf.buffers import MESHOPT
from meshmark_plugins.readers.gltf.container import Container
from meshmark_plugins.readers.gltf.draco import EXTENSION as DRACO
from meshmark_plugins.readers.gltf.element import Element
from meshmark_plugins.readers.gltf.geometry import POSITION

FLOAT, FLOAT_CODE = np.dtype("<f4"), 5126
WIDTH = 3 * FLOAT.itemsize


@dataclass(frozen=True)
class Place:
    """Where the positions of an accessor stand.

    Parameters
    ----------
    accessor : int
    begin, stride, count : int
        In bytes of the binary chunk; number of positions.
    """

    accessor: int
    begin: int
    stride: int
    count: int

    @property
    def end(self) -> int:
        """Where they end."""
        return self.begin + (self.count - 1) * self.stride + WIDTH

    def within(self, binary: bytearray) -> NDArray[np.float32]:
        """Return the positions as a view of the binary chunk, (N, 3)."""
        return np.ndarray((self.count, 3), FLOAT, binary, self.begin, (self.stride, FLOAT.itemsize))


def find_places(container: Container) -> tuple[Place, ...]:
    """Find the positions of all meshes of a file that `read` accepts.

    Raises
    ------
    UsageError
        If they cannot be replaced: outside of a binary chunk, compressed, sparse, quantised, or
        the same bytes for several accessors.
    """
    if container.binary is None:
        raise UsageError("only binary glTF (.glb) is written back; a .usdc always can be written")
    root = container.root
    accessors = root.objects("accessors")
    used: dict[int, None] = {}
    for mesh in root.objects("meshes"):
        for primitive in mesh.objects("primitives"):
            if primitive.extension(DRACO) is not None:
                _refuse(primitive.place, "is compressed")
            used[primitive.object("attributes").index(POSITION, accessors)] = None
    places = sorted((_place(root, index) for index in used), key=lambda place: place.begin)
    for one, two in pairwise(places):
        if two.begin < one.end:
            _refuse(f"accessors[{two.accessor}]", f"shares data with accessors[{one.accessor}]")
    return tuple(places)


def _place(root: Element, index: int) -> Place:
    accessor = root.objects("accessors")[index]
    if "sparse" in accessor or "bufferView" not in accessor:
        _refuse(accessor.place, "is sparse")
    if accessor.integer("componentType") != FLOAT_CODE:
        _refuse(accessor.place, "is quantised")
    views = root.objects("bufferViews")
    view = views[accessor.index("bufferView", views)]
    if view.extension(*MESHOPT) is not None:
        _refuse(view.place, "is compressed")
    if view.integer("buffer") or "uri" in root.objects("buffers")[0]:
        _refuse(view.place, "is not in the binary chunk")
    return Place(
        index,
        view.integer("byteOffset", default=0) + accessor.integer("byteOffset", default=0),
        view.integer("byteStride", default=WIDTH),
        accessor.integer("count", low=1),
    )


def _refuse(place: str, reason: str) -> None:
    raise UsageError(f"{place} {reason}, so it is not written back; a .usdc always can be written")
