"""How much a mesh or an animation was distorted, in the measures the field reports.

Surface distances compare two triangle meshes that need not share a connectivity (see
`meshmark.surface_distance`); the others compare the same vertices before and after.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meshmark.animation import Frame, MeshAnimation
from meshmark.errors import UsageError
from meshmark.surface_distance import SurfaceDistance, hausdorff, mrms, surface_distance
from meshmark.topology import edges

__all__ = [
    "Distortion",
    "SurfaceDistance",
    "distortion",
    "flicker",
    "flipped_faces",
    "hausdorff",
    "max_move_edges",
    "mrms",
    "surface_distance",
]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# A face whose normal is shorter than this share of its longest edge squared has no direction.
_SLIVER = 1e-12


def flipped_faces(V0: FloatArray, V1: FloatArray, F: IntArray) -> int:
    """Count the faces whose normal turned by more than 90 degrees.

    A face without area before or after has no normal and is not counted.

    Parameters
    ----------
    V0, V1 : (N, 3) float64
        Vertex positions before and after.
    F : (F, 3) int
        Triangles.
    """
    n0, n1 = _normals(V0, F), _normals(V1, F)
    return int(np.count_nonzero(np.einsum("ij,ij->i", n0, n1) < 0))


def max_move_edges(V0: FloatArray, V1: FloatArray, F: IntArray) -> float:
    """Measure the largest move of a vertex in mean edge lengths of the mesh before.

    Parameters
    ----------
    V0, V1 : (N, 3) float64
        Vertex positions before and after.
    F : (F, 3) int
        Triangles.
    """
    E = edges(F)
    length = float(np.linalg.norm(V0[E[:, 0]] - V0[E[:, 1]], axis=1).mean()) if len(E) else 0.0
    move = float(np.linalg.norm(V1 - V0, axis=1).max(initial=0.0))
    if move == 0.0:
        return 0.0
    return move / length if length > 0 else math.inf


def flicker(D: FloatArray) -> float:
    """Measure how restless displacements are over time.

    Parameters
    ----------
    D : (T, N, 3) float64
        Displacement of each vertex in consecutive frames.

    Returns
    -------
    float
        RMS of D[t + 1] - D[t] over the RMS of D, over all vertices and frames: 0 for a
        displacement that stays, sqrt(2) for one that is new in every frame, 2 for one that
        alternates in sign; 0 too without displacement or with a single frame.
    """
    total = _Restlessness()
    for displacement in D:
        total.add(displacement)
    return total.ratio()


@dataclass(frozen=True)
class Distortion:
    """Distortion of an animation: means over its frames, but for flicker, which spans them.

    Parameters
    ----------
    hausdorff, mrms : float
        Surface distances in the unit of the points.
    hausdorff_rel, mrms_rel : float
        The same over the diagonal of the original frame's bounding box.
    flipped_faces : float
        Faces whose normal turned by more than 90 degrees.
    max_move_edges : float
        Largest move of a vertex in mean edge lengths.
    flicker : float
        Change of the displacement between neighbouring frames over the displacement.

    Notes
    -----
    The last three are NaN where the two animations do not share their vertices and faces.
    """

    hausdorff: float
    mrms: float
    hausdorff_rel: float
    mrms_rel: float
    flipped_faces: float
    max_move_edges: float
    flicker: float


def distortion(
    original: MeshAnimation,
    marked: MeshAnimation,
    frames: Sequence[int] | None = None,
    *,
    samples: int | None = None,
    seed: int = 0,
) -> Distortion:
    """Measure the distortion of an animation, reading one pair of frames at a time.

    Parameters
    ----------
    original, marked : MeshAnimation
        As many frames each; compared in order.
    frames : sequence of int, optional
        Indices of the frames to compare, increasing; all by default. Flicker is then between
        neighbours among these.
    samples, seed
        As in `surface_distance`.

    Raises
    ------
    UsageError
        If the animations have different numbers of frames, or no frame is asked for.
    """
    if len(original) != len(marked):
        raise UsageError(
            f"{len(marked)} frames cannot be compared with {len(original)}",
            source=original.origin or None,
            prim=original.prim,
        )
    chosen = range(len(original)) if frames is None else frames
    if not len(chosen):
        raise UsageError("there is no frame to compare", prim=original.prim)
    rows = []
    total = _Restlessness()
    for index in chosen:
        before, after = original[index], marked[index]
        rows.append(_frame_distortion(before, after, samples, seed))
        if before.topology.same_as(after.topology):
            total.add(after.points - before.points)
    means = [float(mean) for mean in np.mean(rows, axis=0)]
    corresponding = not math.isnan(means[-1])
    return Distortion(
        hausdorff=means[0],
        mrms=means[1],
        hausdorff_rel=means[2],
        mrms_rel=means[3],
        flipped_faces=means[4],
        max_move_edges=means[5],
        flicker=total.ratio() if corresponding else math.nan,
    )


def _frame_distortion(
    before: Frame, after: Frame, samples: int | None, seed: int
) -> tuple[float, ...]:
    distance = surface_distance(
        before.points, before.faces, after.points, after.faces, samples=samples, seed=seed
    )
    row = (
        distance.hausdorff,
        distance.mrms,
        distance.hausdorff / distance.diagonal,
        distance.mrms / distance.diagonal,
    )
    if not before.topology.same_as(after.topology):
        return (*row, math.nan, math.nan)
    pair = (before.points, after.points, before.faces)
    return (*row, float(flipped_faces(*pair)), max_move_edges(*pair))


def _normals(V: FloatArray, F: IntArray) -> FloatArray:
    """Compute face normals of any length, zero where there is no direction, (F, 3)."""
    a, b, c = V[F[:, 0]], V[F[:, 1]], V[F[:, 2]]
    n = np.cross(b - a, c - a)
    longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1), ((a - c) ** 2).sum(1)], axis=0)
    n[np.linalg.norm(n, axis=1) <= _SLIVER * longest] = 0.0
    return n


class _Restlessness:
    """Sums for `flicker`, one frame at a time."""

    def __init__(self) -> None:
        self._last: FloatArray | None = None
        self._size = self._change = 0.0
        self._frames = 0

    def add(self, D: FloatArray) -> None:
        """Take in the displacement of the next frame, (N, 3)."""
        self._size += float(np.mean(np.sum(D**2, axis=1)))
        if self._last is not None and len(self._last) == len(D):
            self._change += float(np.mean(np.sum((D - self._last) ** 2, axis=1)))
        self._last = D
        self._frames += 1

    def ratio(self) -> float:
        """Return the RMS change over the RMS size so far."""
        if self._frames < 2 or self._size == 0.0:
            return 0.0
        return math.sqrt((self._change / (self._frames - 1)) / (self._size / self._frames))
