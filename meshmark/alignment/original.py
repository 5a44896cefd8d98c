"""The original, as frames of a copy are compared with it."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.pose_samples import PoseSamples
from meshmark.alignment.poses import posed
from meshmark.alignment.procrustes import misfits
from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import AlignmentError, InputError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.checks import require_extent, require_measurable
from meshmark.mesh.closest_points import sample_surface
from meshmark.mesh.frame_range import spread
from meshmark.mesh.geometry import surface_box
from meshmark.mesh.skinning import Skinning
from meshmark.mesh.welding import Welding

PAIRS = 1000
# Frames that are kept.
REMEMBERED = 6


class Original:
    """One mesh of the original, and what is known of its poses.

    Parameters
    ----------
    animation : MeshAnimation
        It remembers the frames it was asked for last.

    Attributes
    ----------
    diagonal : float
    centre : (3,) float64
        Of the bounding box of its first frame.

    Raises
    ------
    AlignmentError
        If its connectivity changes over time, or it has no extent.
    """

    def __init__(self, animation: MeshAnimation) -> None:
        if not animation.constant_topology:
            raise self._unfit(animation, "the connectivity of the original changes over time")
        self.animation = animation.remembered(REMEMBERED)
        first = self.animation[0]
        self.n_points = first.topology.n_points
        try:
            require_measurable(first.points)
            require_extent(first.points, first.faces)
        except InputError as error:
            raise self._unfit(animation, error.message) from None
        self.diagonal, self.centre = surface_box(first.points, first.faces)

    @cached_property
    def welding(self) -> Welding:
        """Its vertices, coincident ones as one."""
        return Welding.of(self.animation[0])

    @cached_property
    def skinning(self) -> Skinning | None:
        """How joints move its welded vertices, if it is known."""
        found = self.animation.skinning
        return None if found is None else found.of(self.welding.kept)

    @cached_property
    def samples(self) -> PoseSamples:
        """Few points of its surface in many poses."""
        return PoseSamples(self.animation)

    @cached_property
    def _vertices(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Some vertices, (m,), poses, (k,), and where the vertices are in them, (k, m, 3)."""
        used = np.unique(self.animation[0].faces)
        some = used[spread(len(used), PAIRS)]
        poses = self.samples.poses.astype(np.float64)
        where = np.stack([self.animation[int(k)].points[some] for k in poses])
        # Halfway between two frames, a third may be nearer than either.
        between = 0.5 * (where[1:] + where[:-1])
        poses = np.concatenate([poses, 0.5 * (poses[1:] + poses[:-1])])
        return some, poses, np.concatenate([where, between])

    def pose_of(self, frame: CopyFrame) -> float | None:
        """Find the sampled pose that resembles a frame of the same vertices most.

        Returns
        -------
        float or None
            None if the frame has too few of them.
        """
        some, poses, where = self._vertices
        slot = np.minimum(np.searchsorted(frame.vertices, some), len(frame.vertices) - 1)
        there = frame.vertices[slot] == some
        if there.sum() < 4:
            return None
        return float(poses[misfits(frame.points[slot[there]], where[:, there]).argmin()])

    def surface_samples(self, pose: float, n: int) -> FloatArray:
        """Spread points over the surface in a pose, (n, 3)."""
        frame = posed(self.animation, pose)
        return sample_surface(frame.points, frame.faces, n, np.random.default_rng(0))

    @staticmethod
    def _unfit(animation: MeshAnimation, reason: str) -> AlignmentError:
        return AlignmentError(reason, source=animation.origin, prim=animation.prim)
