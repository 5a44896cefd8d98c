"""What a mesh of a document is made of: vertices of all its primitives, and their triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError
from meshmark.mesh.topology import Topology
from meshmark_plugins.readers.gltf.accessors import Accessors
from meshmark_plugins.readers.gltf.buffers import Buffers
from meshmark_plugins.readers.gltf.draco import EXTENSION as DRACO
from meshmark_plugins.readers.gltf.draco import DracoMesh, draco_mesh, not_installed
from meshmark_plugins.readers.gltf.element import Element

TRIANGLES, STRIP, FAN = 4, 5, 6
POSITION = "POSITION"


@dataclass(frozen=True, eq=False)
class Vertices:
    """Vertices that primitives share.

    Parameters
    ----------
    points : (N, 3) float
        Positions at rest.
    targets : tuple of (N, 3) float
        Displacements of morph targets.
    joints : (N, 4 K) int
        Joints of a skin; of no columns where there are none.
    weights : (N, 4 K) float
        Their weights.
    """

    points: NDArray[np.floating]
    targets: tuple[NDArray[np.floating], ...]
    joints: IntArray
    weights: NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Geometry:
    """A mesh of a document: the vertices of its primitives behind each other.

    Primitives that use the same vertices share them; so do the triangles of several materials.

    Parameters
    ----------
    vertices : Vertices
        Of all primitives, in the order they are first used.
    topology : Topology
        Triangles of all primitives, in their order.
    passed_over : int
        Number of primitives of points or lines.
    positions : tuple of (int, int)
        Accessors that hold the points, and the point that each one's begin with.
    targets : tuple of tuple of (int or None)
        Of each of these, the accessors of its morph targets; None for one that moves none of them.
    """

    vertices: Vertices
    topology: Topology
    passed_over: int
    positions: tuple[tuple[int, int], ...]
    targets: tuple[tuple[int | None, ...], ...]


class Meshes:
    """Reads meshes of a document.

    Parameters
    ----------
    root : Element
        The document.
    accessors : Accessors
    buffers : Buffers
    """

    def __init__(self, root: Element, accessors: Accessors, buffers: Buffers) -> None:
        self.elements = root.objects("meshes")
        self._accessors = accessors
        self._buffers = buffers
        self._read: dict[int, Geometry | None] = {}

    def geometry(self, index: int) -> Geometry | None:
        """Read a mesh, once; None if it has no triangles, but points or lines.

        Raises
        ------
        InputError
            If its data does not fit together.
        """
        if index not in self._read:
            self._read[index] = self._geometry(self.elements[index])
        return self._read[index]

    def _geometry(self, mesh: Element) -> Geometry | None:
        primitives = mesh.objects("primitives")
        if not primitives:
            mesh.fail("primitives", "is missing or empty")
        if len({len(each.objects("targets")) for each in primitives}) > 1:
            mesh.fail("primitives", "have different numbers of morph targets")
        solid = [each for each in primitives if _mode(each) >= TRIANGLES]
        shared: dict[str, tuple[int, Vertices]] = {}
        parts: list[tuple[int, Topology]] = []
        positions: list[tuple[int, int]] = []
        targets: list[tuple[int | None, ...]] = []
        n_points = 0
        for primitive in solid:
            packed = self._unpacked(primitive)
            key = _key(primitive)
            if key not in shared:
                shared[key] = n_points, self._vertices(primitive, packed)
                positions.append((_position_of(primitive), n_points))
                targets.append(_targets_of(primitive))
                n_points += len(shared[key][1].points)
            offset, vertices = shared[key]
            parts.append((offset, self._topology(primitive, packed, len(vertices.points))))
        if not solid:
            return None
        vertices = _joined([vertices for _, vertices in shared.values()])
        return Geometry(
            vertices,
            _one_topology(parts, n_points),
            passed_over=len(primitives) - len(solid),
            positions=tuple(positions),
            targets=tuple(targets),
        )

    def _unpacked(self, primitive: Element) -> DracoMesh | None:
        """Decode a primitive; None if it is not compressed, or is there for all readers too."""
        extension = primitive.extension(DRACO)
        if extension is None:
            return None
        view = extension.index("bufferView", self._buffers.views)
        found = draco_mesh(extension, self._buffers.view(view))
        positions = primitive.object("attributes").index(POSITION, self._accessors.elements)
        if found is None and "bufferView" not in self._accessors.elements[positions]:
            raise not_installed(extension)
        return found

    def _vertices(self, primitive: Element, packed: DracoMesh | None) -> Vertices:
        attributes = primitive.object("attributes")
        known = self._accessors.elements
        stored = {} if packed is None else packed.attributes
        points = self._accessors.numbers(
            attributes.index(POSITION, known), 3, stored=stored.get(POSITION)
        )
        n = len(points)
        targets = [
            self._accessors.numbers(target.index(POSITION, known), 3, count=n)
            if POSITION in target
            else np.zeros((n, 3), dtype=np.float32)
            for target in primitive.objects("targets")
        ]
        joints: list[IntArray] = []
        weights: list[NDArray[np.floating]] = []
        while (name := f"JOINTS_{len(joints)}") in attributes:
            of_weights = f"WEIGHTS_{len(joints)}"
            joints.append(
                self._accessors.integers(
                    attributes.index(name, known), 4, count=n, stored=stored.get(name)
                )
            )
            weights.append(
                self._accessors.numbers(
                    attributes.index(of_weights, known), 4, count=n, stored=stored.get(of_weights)
                )
            )
        return Vertices(
            points,
            tuple(targets),
            np.concatenate(joints or [np.zeros((n, 0), dtype=np.uint8)], axis=1),
            np.concatenate(weights or [np.zeros((n, 0), dtype=np.float32)], axis=1),
        )

    def _topology(self, primitive: Element, packed: DracoMesh | None, n: int) -> Topology:
        """Return the triangles of a primitive of `n` vertices."""
        if packed is not None:
            triangles = packed.faces
        else:
            corners: IntArray = np.arange(n)
            if "indices" in primitive:
                index = primitive.index("indices", self._accessors.elements)
                corners = self._accessors.integers(index, 1)[:, 0].astype(np.int64)
            triangles = _split(corners, _mode(primitive))
        try:
            return Topology.fit(np.full(len(triangles), 3), triangles.reshape(-1), n)
        except InputError as error:
            raise InputError(f"{primitive.place}: {error.message}") from None


def _position_of(primitive: Element) -> int:
    """Return the accessor of a primitive's points."""
    return primitive.object("attributes").integer(POSITION)


def _targets_of(primitive: Element) -> tuple[int | None, ...]:
    """Return the accessors of a primitive's morph targets."""
    targets = primitive.objects("targets")
    return tuple(each.integer(POSITION) if POSITION in each else None for each in targets)


def _mode(primitive: Element) -> int:
    return primitive.integer("mode", high=FAN, default=TRIANGLES)


def _split(corners: IntArray, mode: int) -> IntArray:
    """Split the corners (C,) of a list, strip or fan into triangles (F, 3)."""
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    if mode == FAN:
        first = np.full(max(len(corners) - 2, 0), corners[0])
        return np.stack([first, corners[1:-1][: len(first)], corners[2:]], axis=1)
    triangles = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    # Every other one is turned round; those that lead from strip to strip have no area.
    triangles[1::2] = triangles[1::2, [1, 0, 2]]
    a, b, c = triangles.T
    return triangles[(a != b) & (b != c) & (c != a)]


def _key(primitive: Element) -> str:
    """Return what is equal for primitives that use the same vertices."""
    packed = primitive.extension(DRACO)
    attributes = primitive.object("attributes").members
    used = {
        name: value
        for name, value in attributes.items()
        if name == POSITION or name.startswith(("JOINTS_", "WEIGHTS_"))
    }
    targets = [target.members.get(POSITION) for target in primitive.objects("targets")]
    return repr((sorted(used.items()), targets, packed and packed.members))


def _joined(parts: Sequence[Vertices]) -> Vertices:
    """Put vertices behind each other; where a part has fewer joints, others get weight 0."""
    if len(parts) == 1:
        return parts[0]
    width = max(part.joints.shape[1] for part in parts)
    return Vertices(
        np.concatenate([part.points for part in parts]),
        tuple(np.concatenate(each) for each in zip(*(part.targets for part in parts), strict=True)),
        np.concatenate([_widened(part.joints, width) for part in parts]),
        np.concatenate([_widened(part.weights, width) for part in parts]),
    )


def _widened(array: NDArray[Any], width: int) -> NDArray[Any]:
    return np.pad(array, ((0, 0), (0, width - array.shape[1])))


def _one_topology(parts: Sequence[tuple[int, Topology]], n_points: int) -> Topology:
    """Put topologies behind each other, each over the vertices from an offset on."""
    if len(parts) == 1:
        return parts[0][1]
    return Topology(
        np.concatenate([topology.counts for _, topology in parts]),
        np.concatenate([topology.indices + offset for offset, topology in parts]),
        n_points,
        next((topology.left_out for _, topology in parts if topology.left_out), ""),
    )


def rest_points(vertices: Vertices, weights: FloatArray) -> FloatArray:
    """Return the positions (N, 3) float64 before skinning, morphed by weights (targets,)."""
    points = vertices.points.astype(np.float64)
    for weight, target in zip(weights, vertices.targets, strict=True):
        if weight:
            points += weight * target.astype(np.float64)
    return points
