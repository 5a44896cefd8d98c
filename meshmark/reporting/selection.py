"""What of an asset is shown: some points of its meshes, at some times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import CapacityError, InputError
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.frame_range import frames_in, has_frame_in, spread
from meshmark.reporting.decimation import ShownMesh, shown_mesh

# Frames and points that are shown at most, and meshes, the largest first.
FRAMES, POINTS, MESHES = 16, 6000, 48
# Of these points, what every mesh gets, however small it is.
EACH = 40


@dataclass(frozen=True, eq=False)
class Selection:
    """Points of meshes, and times.

    Parameters
    ----------
    meshes : tuple of ShownMesh
    times : (T,) float64
        Time codes; the one of a mesh that has no times is NaN.
    n_frames, n_meshes, n_points : int
        What there is in all: frames of the longest mesh that is shown, meshes, and their points.
    """

    meshes: tuple[ShownMesh, ...]
    times: FloatArray
    n_frames: int
    n_meshes: int
    n_points: int

    @property
    def lead(self) -> MeshAnimation:
        """The longest mesh that is shown, or run of one."""
        return longest_of(self.meshes)

    @property
    def shown(self) -> int:
        """Points that are shown."""
        return sum(len(mesh.points) for mesh in self.meshes)

    def at(self, times: Sequence[float]) -> Selection:
        """Choose from other times."""
        wanted = np.array(times, dtype=np.float64)
        return replace(self, times=wanted[spread(len(wanted), FRAMES)])


def select(
    asset: Asset, recipes: Sequence[Recipe] = (), frames: str | None = None
) -> Selection | None:
    """Choose what of an asset is shown; None if nothing of it can be.

    Parameters
    ----------
    asset : Asset
    recipes : sequence of Recipe
        Schemes of which it is shown where their carriers stand.
    frames : str, optional
        Range A:B[:S] of time codes to choose from.
    """
    sizes = {mesh.prim: _size(mesh) for mesh in asset.meshes}
    largest = sorted(asset.meshes, key=lambda mesh: -sizes[mesh.prim])[:MESHES]
    total = max(1, sum(sizes[mesh.prim] for mesh in largest))
    spare = POINTS - EACH * len(largest)
    chosen = []
    for mesh in largest:
        try:
            chosen.append(shown_mesh(mesh, EACH + spare * sizes[mesh.prim] // total, recipes))
        except (CapacityError, InputError):
            # Verdicts tell of meshes that cannot be read.
            continue
    if not chosen:
        return None
    lead = longest_of(chosen)
    inside = frames_in(lead, frames if has_frame_in(lead, frames) else None)
    times = lead.times[[inside[i] for i in spread(len(inside), FRAMES)]]
    n_frames = max(each.n_frames for each in chosen)
    return Selection(tuple(chosen), times, n_frames, len(asset.meshes), sum(sizes.values()))


def longest_of(meshes: Sequence[ShownMesh]) -> MeshAnimation:
    """Return the mesh of the most frames."""
    return max((each.mesh for each in meshes), key=len)


def _size(mesh: MeshAnimation) -> int:
    try:
        return int(mesh[0].topology.n_points)
    except InputError:
        return 0
