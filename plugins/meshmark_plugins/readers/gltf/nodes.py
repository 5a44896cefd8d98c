"""The hierarchy of nodes: who is whose parent, where each stands at rest, and what it is called."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.element import Element

# Far more than rigs have; paths of prims are spelled out of all names above.
DEEPEST = 1000
LONGEST_NAME = 80
NOT_ALLOWED = re.compile(r"\W")


class Node(NamedTuple):
    """A node at rest.

    Parameters
    ----------
    name : str
        A valid name; that of its mesh, or its number, where it has none.
    children : tuple of int
    translation, rotation, scale : tuple of float
        Relative to its parent; rotation is a quaternion x, y, z, w.
    matrix : tuple of 16 float, optional
        In column order, in place of the three.
    mesh, skin : int, optional
    """

    name: str
    children: tuple[int, ...]
    translation: tuple[float, ...]
    rotation: tuple[float, ...]
    scale: tuple[float, ...]
    matrix: tuple[float, ...] | None
    mesh: int | None
    skin: int | None


@dataclass(frozen=True)
class Hierarchy:
    """All nodes of a document.

    Parameters
    ----------
    nodes : tuple of Node
    parents : tuple of int
        Of each node; -1 for roots.
    order : tuple of int
        Nodes with parents before their children.
    """

    nodes: tuple[Node, ...]
    parents: tuple[int, ...]
    order: tuple[int, ...]

    def below(self, roots: Sequence[int]) -> tuple[int, ...]:
        """List some nodes and all nodes below them, in the order of a walk, each once."""
        found: dict[int, None] = {}
        waiting = list(reversed(roots))
        while waiting:
            node = waiting.pop()
            if node not in found:
                found[node] = None
                waiting += reversed(self.nodes[node].children)
        return tuple(found)

    def above(self, wanted: Sequence[int]) -> tuple[int, ...]:
        """List some nodes and all that they hang from, parents first."""
        needed: set[int] = set()
        for node in wanted:
            while node >= 0 and node not in needed:
                needed.add(node)
                node = self.parents[node]
        return tuple(node for node in self.order if node in needed)

    def paths(self) -> dict[int, str]:
        """Spell a path for each node: names from the root on, made unique among siblings."""
        paths: dict[int, str] = {}
        taken: set[str] = set()
        for node in self.order:
            parent = self.parents[node]
            path = base = f"{paths[parent] if parent >= 0 else ''}/{self.nodes[node].name}"
            n = 2
            while path in taken:
                path, n = f"{base}_{n}", n + 1
            taken.add(path)
            paths[node] = path
        return paths


def read_nodes(root: Element) -> Hierarchy:
    """Read the nodes of a document.

    Raises
    ------
    InputError
        If one has two parents, is its own ancestor, or is too deep below its root.
    """
    elements, meshes = root.objects("nodes"), root.objects("meshes")
    known, skins = range(len(elements)), range(len(root.objects("skins")))
    nodes = tuple(_node(each, i, known, meshes, skins) for i, each in enumerate(elements))
    parents = [-1] * len(nodes)
    for index, node in enumerate(nodes):
        for child in node.children:
            if parents[child] >= 0:
                raise InputError(f"nodes[{child}] is a child of two nodes, or twice of one")
            parents[child] = index
    return Hierarchy(nodes, tuple(parents), _in_order(nodes, parents))


def scene_roots(root: Element, hierarchy: Hierarchy) -> tuple[int, ...]:
    """Return the roots of the default scene, or of the first; all roots where there is none."""
    scenes = root.objects("scenes")
    if not scenes:
        return tuple(node for node in hierarchy.order if hierarchy.parents[node] < 0)
    chosen = root.optional_index("scene", scenes) or 0
    return scenes[chosen].indices("nodes", hierarchy.nodes)


def _node(
    node: Element,
    index: int,
    nodes: range,
    meshes: Sequence[Element],
    skins: range,
) -> Node:
    mesh = node.optional_index("mesh", meshes)
    name = node.text("name", "") or ("" if mesh is None else meshes[mesh].text("name", ""))
    return Node(
        name=_valid(name) or f"node{index}",
        children=node.indices("children", nodes),
        translation=node.numbers("translation", 3, (0.0, 0.0, 0.0)),
        rotation=node.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0)),
        scale=node.numbers("scale", 3, (1.0, 1.0, 1.0)),
        matrix=node.numbers("matrix", 16, ()) if "matrix" in node else None,
        mesh=mesh,
        skin=node.optional_index("skin", skins),
    )


def _valid(name: str) -> str:
    """Turn a name into one that is valid as part of a path of prims."""
    name = NOT_ALLOWED.sub("_", name[:LONGEST_NAME])
    return f"_{name}" if name[:1].isdigit() else name


def _in_order(nodes: Sequence[Node], parents: Sequence[int]) -> tuple[int, ...]:
    order: list[int] = []
    level = [node for node, parent in enumerate(parents) if parent < 0]
    depth = 0
    while level:
        depth += 1
        if depth > DEEPEST:
            raise InputError(f"nodes[{level[0]}] is more than {DEEPEST} nodes below its root")
        order += level
        level = [child for node in level for child in nodes[node].children]
    if len(order) < len(nodes):
        lost = min(set(range(len(nodes))) - set(order))
        raise InputError(f"nodes[{lost}] hangs from itself: its ancestors go in a circle")
    return tuple(order)


def rest_parts(
    node: Node,
) -> tuple[
    Sequence[float] | FloatArray, Sequence[float] | FloatArray, Sequence[float] | FloatArray
]:
    """Return translation (3,), rotation (4,) and scale (3,) of a node at rest.

    A matrix is taken apart, as far as three parts can say what it says: without shear.
    """
    if node.matrix is None:
        return node.translation, node.rotation, node.scale
    matrix = np.array(node.matrix).reshape(4, 4).T
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) < 0:
        scale[0] = -scale[0]
    axes = matrix[:3, :3] / np.where(scale == 0, 1.0, scale)
    return matrix[:3, 3], _quaternion(axes), scale


def _quaternion(rotation: FloatArray) -> FloatArray:
    """Return the unit quaternion x, y, z, w of a rotation (3, 3).

    It is the eigenvector of the largest eigenvalue of a symmetric matrix, whatever the angle.

    References
    ----------
    Bar-Itzhack, "New method for extracting the quaternion from a rotation matrix", 2000.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    K = np.array(
        [
            [xx - yy - zz, xy + yx, xz + zx, zy - yz],
            [xy + yx, yy - xx - zz, yz + zy, xz - zx],
            [xz + zx, yz + zy, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    return np.linalg.eigh(K)[1][:, -1]
