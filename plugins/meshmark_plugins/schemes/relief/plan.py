"""How one animation is raised and lowered: one height a vertex, the same in every frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.flip_guard import restrain
from meshmark.mesh.frame_range import spread
from meshmark.mesh.geometry import vertex_normals
from meshmark_plugins.schemes.relief.height import allowed, room

# Poses in which faces are kept from turning; beyond those, each frame looks after itself.
POSES = 12


@dataclass(frozen=True, eq=False)
class ReliefPlan:
    """Moves every vertex along its normal by a height of its own.

    Parameters
    ----------
    height : (N,) float64
        In the unit of the points.
    carriers : int
        Patches.
    """

    height: FloatArray
    carriers: int

    def mark(self, index: int, frame: Frame) -> FloatArray:
        """Return the marked positions of a frame; a face that would turn over is left alone."""
        V, F = frame.points, frame.faces
        moved = V + self.height[:, None] * vertex_normals(V, F)
        return restrain(V, moved, F, reach=np.inf)


def plan_heights(animation: MeshAnimation, f: FloatArray) -> FloatArray:
    """Lower heights f (N,) where the surface is thin or its triangles are small, in any pose."""
    share = np.ones(len(f))
    for index in spread(len(animation), POSES):
        frame = animation[index]
        V, F = frame.points, frame.faces
        height = np.abs(share * f)
        limit = room(V, F)
        share *= np.divide(limit, height, out=np.ones(len(f)), where=height > limit)
        share *= allowed(V, F, share * f)
    return share * f
