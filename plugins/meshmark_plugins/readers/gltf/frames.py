"""Frames of one mesh of a node, computed when they are asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import InputError
from meshmark.mesh.animation import Frame
from meshmark.mesh.checks import require_measurable
from meshmark.mesh.skinning import Skinning
from meshmark_plugins.readers.gltf.clips import Row
from meshmark_plugins.readers.gltf.geometry import Geometry, rest_points
from meshmark_plugins.readers.gltf.poses import Rig
from meshmark_plugins.readers.gltf.skins import Binding
from meshmark_plugins.readers.gltf.timeline import Timeline


@dataclass(frozen=True, eq=False)
class GltfFrames:
    """A mesh: morphed, then skinned or moved with its node, into world space.

    Parameters
    ----------
    geometry : Geometry
    weights : (targets,) float64
        Of the morph targets, at rest.
    weights_row : Row or None
        How they change.
    rig : Rig
        The node alone; or the joints of the skin, and the node.
    binding : Binding or None
        To the skin, if there is one.
    timeline : Timeline
        Frames; a single one of no time for a mesh that does not change.
    source, prim : str
        For messages.
    """

    geometry: Geometry
    weights: FloatArray
    weights_row: Row | None
    rig: Rig
    binding: Binding | None
    timeline: Timeline
    source: str
    prim: str

    def frame(self, index: int) -> Frame:
        """Compute frame `index`."""
        seconds = self.timeline.seconds(index)
        # What is out of range is refused below.
        with np.errstate(over="ignore", invalid="ignore"):
            points = self._points(seconds)
        time = float(self.timeline.codes[index])
        try:
            require_measurable(points)
        except InputError as error:
            raise InputError(error.message, source=self.source, prim=self.prim, time=time) from None
        return Frame(time, points, self.geometry.topology)

    def skinning(self) -> Skinning | None:
        """Return how joints move the points, if there is a skin."""
        if self.binding is None:
            return None
        rest = rest_points(self.geometry.vertices, self.weights)
        return Skinning.fit(rest, *self.binding.listed())

    def derivative(self, index: int) -> FloatArray:
        """Return how points of frame `index` follow those at rest: (N, 3, 3), or (1, 3, 3)."""
        # The frame itself was measurable.
        with np.errstate(over="ignore", invalid="ignore"):
            worlds = self.rig.worlds(self.timeline.seconds(index))
        if self.binding is not None:
            return self.binding.blended(worlds)[:, :, :3]
        return worlds[:1, :3, :3]

    def _points(self, seconds: float) -> FloatArray:
        weights = self.weights
        if self.weights_row is not None:
            tracks, row = self.weights_row
            weights = tracks.at(seconds, row)
        points = rest_points(self.geometry.vertices, weights)
        worlds = self.rig.worlds(seconds)
        if self.binding is not None:
            return self.binding.skinned(points, worlds)
        return points @ worlds[0, :3, :3].T + worlds[0, :3, 3]
