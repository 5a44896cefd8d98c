"""Where nodes stand in world space at a time of a clip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark_plugins.readers.gltf.clips import WEIGHTS, WIDTHS, Clip, Track
from meshmark_plugins.readers.gltf.nodes import Hierarchy, rest_parts

# Translation, rotation and scale of nodes: (R, 3), (R, 4), (R, 3).
Parts = tuple[FloatArray, FloatArray, FloatArray]
AT_ORIGIN = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (1.0, 1.0, 1.0))


@dataclass(frozen=True, eq=False)
class Rig:
    """The nodes that one mesh hangs from, and how they move.

    Parameters
    ----------
    parents : tuple of int
        Of each of its nodes, by their numbers in the rig, parents first; -1 for roots.
    rest : tuple of arrays
        Translation (R, 3), rotation (R, 4) and scale (R, 3) of each in its parent's space.
    fixed : mapping of int to (4, 4) float64
        Matrices of nodes that have one, and that no clip moves.
    tracks : tuple of (int, int, Track)
        How a clip moves them: the part, the node, and its values over time.
    places : tuple of int
        Of the nodes that were asked for.
    """

    parents: tuple[int, ...]
    rest: Parts
    fixed: Mapping[int, FloatArray]
    tracks: tuple[tuple[int, int, Track], ...]
    places: tuple[int, ...]

    def worlds(self, time: float) -> FloatArray:
        """Return where the nodes asked for stand at a time in seconds, (n, 4, 4) float64."""
        translation, rotation, scale = parts = tuple(part.copy() for part in self.rest)
        for part, node, track in self.tracks:
            parts[part][node] = track.at(time)
        worlds = local_matrices(translation, rotation, scale)
        for node, matrix in self.fixed.items():
            worlds[node] = matrix
        for node, parent in enumerate(self.parents):
            if parent >= 0:
                worlds[node] = worlds[parent] @ worlds[node]
        return worlds[list(self.places)]


def rig_of(hierarchy: Hierarchy, clip: Clip | None, wanted: Sequence[int]) -> Rig:
    """Collect what some nodes hang from, and how a clip moves it."""
    needed = hierarchy.above(wanted)
    place = {node: i for i, node in enumerate(needed)}
    tracks = {} if clip is None else clip.tracks
    moving = [
        (part, place[node], tracks[node, path])
        for node in needed
        for part, path in enumerate(WIDTHS)
        if (node, path) in tracks
    ]
    moved = {node for _, node, _ in moving}
    nodes = [hierarchy.nodes[node] for node in needed]
    fixed = {i: node.matrix for i, node in enumerate(nodes) if node.matrix and i not in moved}
    parts = [AT_ORIGIN if i in fixed else rest_parts(node) for i, node in enumerate(nodes)]
    translation, rotation, scale = (np.array(part) for part in zip(*parts, strict=True))
    return Rig(
        parents=tuple(place.get(hierarchy.parents[node], -1) for node in needed),
        rest=(translation, rotation, scale),
        fixed={i: np.array(matrix).reshape(4, 4).T for i, matrix in fixed.items()},
        tracks=tuple(moving),
        places=tuple(place[node] for node in wanted),
    )


def weights_track(clip: Clip | None, node: int) -> Track | None:
    """Return how a clip changes the weights of a node's morph targets."""
    return None if clip is None else clip.tracks.get((node, WEIGHTS))


def local_matrices(translation: FloatArray, rotation: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the matrices (R, 4, 4) that scale, then rotate, then move.

    A quaternion (x, y, z, w) of any length but 0 stands for its rotation; 0 for none.
    """
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
