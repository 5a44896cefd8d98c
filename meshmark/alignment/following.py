"""Places one frame of a copy after another was placed."""

from __future__ import annotations

from collections.abc import Sequence

from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.fit import Fit
from meshmark.alignment.maps import maps_of, similarity_of
from meshmark.alignment.matching import ClosestAt, PairedAt
from meshmark.alignment.original import Original
from meshmark.alignment.placement import FramePlacement
from meshmark.alignment.refinement import Placement
from meshmark.alignment.search import EXACT, IDENTITY, PCA, REPOSED, SLIDES, Search
from meshmark.errors import MeshmarkError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.breakdown import breakdown_means_no_capacity


class FollowFrame:
    """Places one frame after another was placed; pickles, for worker processes."""

    def __init__(
        self, meshes: Sequence[MeshAnimation], original: Original, method: str, start: Placement
    ) -> None:
        self._meshes, self._original = tuple(meshes), original
        self._method, self._start = method, start

    def __call__(self, index: int) -> FramePlacement | None:
        """Return the placement of a frame of the copy; None if it does not fit."""
        try:
            with breakdown_means_no_capacity():
                return self._placed(index)
        except MeshmarkError:
            # A frame that cannot be read, or lies anywhere.
            return None

    def _placed(self, index: int) -> FramePlacement | None:
        search = Search(self._meshes, self._original)
        frame = CopyFrame.of(self._meshes, index)
        fit: Fit | None = None
        by_vertex = self._method in (IDENTITY, REPOSED)
        if not by_vertex:
            fit = search.near(frame, self._start)
        if fit is None or not fit.fits:
            fit = search.place(frame, self._method if by_vertex else PCA)
        if fit is None or not fit.fits:
            return None
        some, pose = frame.some(EXACT), fit.placement.pose
        if self._method == REPOSED:
            maps = {"similarity": similarity_of(some.points, fit.placement)}
        else:
            paired = self._method == IDENTITY and fit.slip >= SLIDES
            at = PairedAt(self._original, some) if paired else ClosestAt(self._original)
            maps = maps_of(some.points, fit.placement, at(pose), fit.covered)
        return FramePlacement(index, pose, maps, fit.residual, fit.covered)
