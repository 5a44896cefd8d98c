"""Where nodes stand in world space at a time of a clip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark_plugins.readers.gltf.clips import WEIGHTS, WIDTHS, Clip, Track
from meshmark_plugins.readers.gltf.nodes import Hierarchy, rest_parts


@dataclass(frozen=True, eq=False)
class Rig:
    """The nodes that one mesh hangs from, and how they move.

    Parameters
    ----------
    parents : tuple of int
        Of each of its nodes, by their numbers in the rig, parents first; -1 for roots.
    locals : (R, 4, 4) float64
        Where each stands in its parent's space, at rest.
    moving : tuple of (int, parts, tracks)
        Nodes that a clip moves, their translation, rotation and scale at rest, and their tracks.
    places : tuple of int
        Of the nodes that were asked for.
    """

    parents: tuple[int, ...]
    locals: FloatArray
    moving: tuple[tuple[int, tuple[FloatArray, ...], tuple[Track | None, ...]], ...]
    places: tuple[int, ...]

    def worlds(self, time: float) -> FloatArray:
        """Return where the nodes asked for stand at a time in seconds, (n, 4, 4) float64."""
        worlds = self.locals.copy()
        for node, rest, tracks in self.moving:
            worlds[node] = local_matrix(
                *(
                    part if track is None else track.at(time)
                    for part, track in zip(rest, tracks, strict=True)
                )
            )
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
        (place[node], rest_parts(hierarchy.nodes[node]), found)
        for node in needed
        if any(found := tuple(tracks.get((node, path)) for path in WIDTHS))
    ]
    return Rig(
        parents=tuple(place.get(hierarchy.parents[node], -1) for node in needed),
        locals=np.array([_rest_matrix(hierarchy, node) for node in needed]),
        moving=tuple(moving),
        places=tuple(place[node] for node in wanted),
    )


def weights_track(clip: Clip | None, node: int) -> Track | None:
    """Return how a clip changes the weights of a node's morph targets."""
    return None if clip is None else clip.tracks.get((node, WEIGHTS))


def local_matrix(translation: FloatArray, rotation: FloatArray, scale: FloatArray) -> FloatArray:
    """Return the matrix (4, 4) that scales, then rotates, then moves.

    A quaternion (x, y, z, w) of any length but 0 stands for its rotation; 0 for none.
    """
    matrix = np.eye(4)
    matrix[:3, :3] = _rotation(rotation) * scale
    matrix[:3, 3] = translation
    return matrix


def _rest_matrix(hierarchy: Hierarchy, node: int) -> FloatArray:
    matrix = hierarchy.nodes[node].matrix
    if matrix is not None:
        return np.array(matrix).reshape(4, 4).T
    return local_matrix(*rest_parts(hierarchy.nodes[node]))


def _rotation(quaternion: FloatArray) -> FloatArray:
    x, y, z, w = quaternion.tolist()
    square = x * x + y * y + z * z + w * w
    s = 2.0 / square if square else 0.0
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
    )
