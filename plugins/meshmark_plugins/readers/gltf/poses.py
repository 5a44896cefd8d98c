"""Where nodes stand in world space at a time of a clip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark_plugins.readers.gltf.clips import WEIGHTS, Clip, Row, Tracks
from meshmark_plugins.readers.gltf.nodes import Hierarchy, taken_apart

# Where in ten numbers of a node they stand.
PARTS = {"translation": slice(0, 3), "rotation": slice(3, 7), "scale": slice(7, 10)}


@dataclass(frozen=True, eq=False)
class Rig:
    """The nodes that one mesh hangs from, and how they move.

    Parameters
    ----------
    parents : (R,) int
        Of each of its nodes, by their numbers in the rig; -1 for roots.
    levels : tuple of slice
        Nodes of each depth, but for roots.
    rest : (R, 10) float64
        Translation, rotation and scale of each in its parent's space.
    fixed : mapping of int to (4, 4) float64
        Matrices of nodes that have one, and that no clip moves.
    tracks : tuple of (slice, (n,) int, Tracks, (n,) int)
        How a clip moves them: which part of the ten numbers, the nodes, and their values over
        time, by their rows.
    places : (n,) int
        Of the nodes that were asked for.
    """

    parents: IntArray
    levels: tuple[slice, ...]
    rest: FloatArray
    fixed: Mapping[int, FloatArray]
    tracks: tuple[tuple[slice, IntArray, Tracks, IntArray], ...]
    places: IntArray

    def worlds(self, time: float) -> FloatArray:
        """Return where the nodes asked for stand at a time in seconds, (n, 4, 4) float64."""
        parts = self.rest.copy()
        for part, nodes, tracks, rows in self.tracks:
            parts[nodes, part] = tracks.at(time, rows)
        worlds = local_matrices(parts)
        for node, matrix in self.fixed.items():
            worlds[node] = matrix
        for level in self.levels:
            worlds[level] = worlds[self.parents[level]] @ worlds[level]
        return worlds[self.places]


def rig_of(hierarchy: Hierarchy, clip: Clip | None, wanted: Sequence[int]) -> Rig:
    """Collect what some nodes hang from, and how a clip moves it."""
    needed = hierarchy.above(wanted)
    place = {node: i for i, node in enumerate(needed)}
    rest = hierarchy.rest[needed]
    found: dict[tuple[str, Tracks], dict[int, int]] = {}
    for path in PARTS:
        of_nodes = {} if clip is None else clip.tracks.get(path, {})
        for i, node in enumerate(needed):
            if node in of_nodes:
                tracks, row = of_nodes[node]
                found.setdefault((path, tracks), {})[i] = row
    fixed = {place[node]: hierarchy.matrices[node] for node in needed if node in hierarchy.matrices}
    for i in fixed.keys() & set().union(*found.values()):
        rest[i] = taken_apart(fixed.pop(i))
    return Rig(
        parents=np.array([place.get(hierarchy.parents[node], -1) for node in needed]),
        levels=_levels([hierarchy.depths[node] for node in needed]),
        rest=rest,
        fixed=fixed,
        tracks=tuple(
            (PARTS[path], np.array(list(rows)), tracks, np.array(list(rows.values())))
            for (path, tracks), rows in found.items()
        ),
        places=np.array([place[node] for node in wanted]),
    )


def _levels(depths: Sequence[int]) -> tuple[slice, ...]:
    """Return where nodes of each depth but 0 begin and end."""
    ends = [i for i, (depth, below) in enumerate(pairwise(depths), 1) if below > depth]
    return tuple(slice(*each) for each in pairwise([*ends, len(depths)]))


def weights_row(clip: Clip | None, node: int) -> Row | None:
    """Return how a clip changes the weights of a node's morph targets."""
    return None if clip is None else clip.tracks.get(WEIGHTS, {}).get(node)


def local_matrices(parts: FloatArray) -> FloatArray:
    """Return the matrices (R, 4, 4) that scale, then rotate, then move, of parts (R, 10).

    A quaternion (x, y, z, w) of any length but 0 stands for its rotation; 0 for none.
    """
    translation, rotation, scale = (parts[:, part] for part in PARTS.values())
    square = np.einsum("ij,ij->i", rotation, rotation)
    s = np.divide(2.0, square, out=np.zeros_like(square), where=square != 0)
    # Products of two components: xx, xy and so on.
    x, y, z, w = rotation.T
    sx, sy, sz = s * x, s * y, s * z
    xx, yy, zz = sx * x, sy * y, sz * z
    xy, xz, yz = sx * y, sx * z, sy * z
    wx, wy, wz = sx * w, sy * w, sz * w
    matrices = np.zeros((len(rotation), 4, 4))
    matrices[:, 3, 3] = 1.0
    turn = matrices[:, :3, :3]
    turn[:, 0, 0], turn[:, 1, 1], turn[:, 2, 2] = 1 - (yy + zz), 1 - (xx + zz), 1 - (xx + yy)
    turn[:, 0, 1], turn[:, 1, 0] = xy - wz, xy + wz
    turn[:, 0, 2], turn[:, 2, 0] = xz + wy, xz - wy
    turn[:, 1, 2], turn[:, 2, 1] = yz - wx, yz + wx
    turn *= scale[:, None, :]
    matrices[:, :3, 3] = translation
    return matrices
