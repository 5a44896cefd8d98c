"""The hierarchy of nodes: who is whose parent, where each stands at rest, and what it is called."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.element import Element

# Far more than rigs have; paths of prims are spelled out of all names above.
DEEPEST = 1000
LONGEST_NAME = 80
NOT_ALLOWED = re.compile(r"\W")
AT_ORIGIN = {
    "translation": (0.0, 0.0, 0.0),
    "rotation": (0.0, 0.0, 0.0, 1.0),
    "scale": (1.0, 1.0, 1.0),
}


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """All nodes of a document, by their numbers.

    Parameters
    ----------
    names : list of str
        As they are stored, or those of their meshes.
    children : sequence of sequence of int
    parents : list of int
        -1 for roots.
    depths : list of int
        How many nodes each hangs below.
    rest : (N, 10) float64
        Translation, rotation as a quaternion x, y, z, w, and scale, relative to the parent.
    matrices : mapping of int to (4, 4) float64
        Of nodes that have one, in place of the three.
    meshes, skins : mapping of int to int
        Of nodes that have one.
    """

    names: list[str]
    children: Sequence[Sequence[int]]
    parents: list[int]
    depths: list[int]
    rest: FloatArray
    matrices: Mapping[int, FloatArray]
    meshes: Mapping[int, int]
    skins: Mapping[int, int]

    def below(self, roots: Sequence[int]) -> tuple[int, ...]:
        """List some nodes and all nodes below them, in the order of a walk, each once."""
        found: dict[int, None] = {}
        waiting = list(reversed(roots))
        while waiting:
            node = waiting.pop()
            if node not in found:
                found[node] = None
                waiting += reversed(self.children[node])
        return tuple(found)

    def above(self, wanted: Iterable[int]) -> list[int]:
        """List some nodes and all that they hang from, by their depths: parents first."""
        needed: set[int] = set()
        for node in wanted:
            while node >= 0 and node not in needed:
                needed.add(node)
                node = self.parents[node]
        return sorted(needed, key=lambda node: (self.depths[node], node))

    def paths(self, wanted: Iterable[int]) -> dict[int, str]:
        """Spell a path for nodes: names from the root on, made unique among siblings."""
        paths = {-1: ""}
        for parent in (-1, *self.above(wanted)):
            taken: set[str] = set()
            for node in self.roots if parent < 0 else self.children[parent]:
                base = path = _valid(self.names[node]) or f"node{node}"
                n = 2
                while path in taken:
                    path, n = f"{base}_{n}", n + 1
                taken.add(path)
                paths[node] = f"{paths[parent]}/{path}"
        return paths

    @property
    def roots(self) -> list[int]:
        """Nodes that hang from none."""
        return [node for node, parent in enumerate(self.parents) if parent < 0]


def read_nodes(root: Element) -> Hierarchy:
    """Read the nodes of a document.

    Raises
    ------
    InputError
        If one has two parents, is its own ancestor, or is too deep below its root.
    """
    nodes, meshes, skins = (root.objects(name) for name in ("nodes", "meshes", "skins"))
    children = nodes.index_lists("children", nodes)
    parents = [-1] * len(nodes)
    for node, below in enumerate(children):
        for child in below:
            if parents[child] >= 0:
                raise InputError(f"nodes[{child}] is a child of two nodes, or twice of one")
            parents[child] = node
    mesh_of = {node: nodes[node].index("mesh", meshes) for node in nodes.having("mesh")}
    names = nodes.texts("name", "")
    for node, mesh in mesh_of.items():
        names[node] = names[node] or meshes[mesh].text("name", "")
    return Hierarchy(
        names=names,
        children=children,
        parents=parents,
        depths=_depths(children, parents),
        rest=nodes.numbers(AT_ORIGIN),
        matrices={
            node: np.array(nodes[node].numbers("matrix", 16, ())).reshape(4, 4).T
            for node in nodes.having("matrix")
        },
        meshes=mesh_of,
        skins={node: nodes[node].index("skin", skins) for node in nodes.having("skin")},
    )


def scene_roots(root: Element, hierarchy: Hierarchy) -> Sequence[int]:
    """Return the roots of the default scene, or of the first; all roots where there is none."""
    scenes = root.objects("scenes")
    if not scenes:
        return hierarchy.roots
    chosen = root.optional_index("scene", scenes) or 0
    return scenes[chosen].indices("nodes", hierarchy.parents)


def _valid(name: str) -> str:
    """Turn a name into one that is valid as part of a path of prims."""
    name = NOT_ALLOWED.sub("_", name[:LONGEST_NAME])
    return f"_{name}" if name[:1].isdigit() else name


def _depths(children: Sequence[Sequence[int]], parents: Sequence[int]) -> list[int]:
    depths = [-1] * len(parents)
    level = [node for node, parent in enumerate(parents) if parent < 0]
    depth = 0
    while level:
        if depth >= DEEPEST:
            raise InputError(f"nodes[{level[0]}] is more than {DEEPEST} nodes below its root")
        for node in level:
            depths[node] = depth
        level = [child for node in level for child in children[node]]
        depth += 1
    if -1 in depths:
        lost = depths.index(-1)
        raise InputError(f"nodes[{lost}] hangs from itself: its ancestors go in a circle")
    return depths


def taken_apart(matrix: FloatArray) -> FloatArray:
    """Return translation, rotation and scale, (10,), of a matrix (4, 4).

    It is taken apart as far as three parts can say what it says: without shear.
    """
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) < 0:
        scale[0] = -scale[0]
    axes = matrix[:3, :3] / np.where(scale == 0, 1.0, scale)
    return np.concatenate([matrix[:3, 3], _quaternion(axes), scale])


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
