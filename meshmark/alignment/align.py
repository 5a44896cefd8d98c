"""Where a leaked copy lies on its original."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.maps import maps_of
from meshmark.alignment.matching import ByClosestPoint, ByIdentity, Matcher
from meshmark.alignment.placement import AssetAlignment, FramePlacement, MeshAlignment
from meshmark.alignment.pose_samples import Moments, PoseSamples, spread
from meshmark.alignment.poses import posed, remembered
from meshmark.alignment.procrustes import misfits, robust_similarity
from meshmark.alignment.refinement import Placement, Refinement, Rest
from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import AlignmentError, MeshmarkError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, LeftOut
from meshmark.mesh.closest_points import sample_surface
from meshmark.mesh.frame_range import frames_in
from meshmark.mesh.geometry import face_areas, surface_box

FRAMES = 12
# Most vertices that are read of a frame for the similarity.
MOST_VERTICES = 30_000
ROUGH = 600
# A placement is one if most vertices are nearer than this share of the diagonal, in mean squares.
NEAR, MOST_NEAR, FITS = 0.02, 0.6, 0.01
# The share of vertices whose distances make the residual.
KEPT = 0.9
LEAST_COVERED = 0.03
# Frames that are tried before nothing fits.
TRIED = 3


def align(
    copy: Asset,
    original: Asset,
    *,
    frames: str | None = None,
    n_frames: int = FRAMES,
    jobs: int = 1,
) -> AssetAlignment:
    """Find each mesh of the original in a copy.

    Parameters
    ----------
    copy, original : Asset
    frames : str, optional
        Range A:B[:S] of the copy's time codes; see `meshmark.mesh.frame_range.frames_in`.
    n_frames : int
        How many of these frames are placed at most, spread evenly.
    jobs : int
        Worker processes.

    Returns
    -------
    AssetAlignment
    """
    found: list[MeshAlignment] = []
    unplaced: list[LeftOut] = []
    free = list(copy.meshes)
    for mesh in original.meshes:
        reason = "nothing of the copy is left for it"
        # Those of the same name first.
        for candidate in sorted(free, key=lambda each: each.prim != mesh.prim):
            try:
                inside = frames_in(candidate, frames)
                chosen = [inside[i] for i in spread(len(inside), n_frames)]
                found.append(align_mesh(candidate, mesh, chosen))
            except MeshmarkError as error:
                reason = error.message
                continue
            free.remove(candidate)
            break
        else:
            unplaced.append(LeftOut(mesh.prim, reason))
    return AssetAlignment(tuple(found), tuple(unplaced))


def align_mesh(
    copy: MeshAnimation | Sequence[MeshAnimation], original: MeshAnimation, frames: Sequence[int]
) -> MeshAlignment:
    """Find where frames of a copy lie on one mesh of the original.

    Parameters
    ----------
    copy : MeshAnimation or sequence of MeshAnimation
        Several if the mesh was split: they are read as one.
    original : MeshAnimation
        Of constant topology.
    frames : sequence of int
        Of the copy, or of the first of its meshes.

    Returns
    -------
    MeshAlignment

    Raises
    ------
    AlignmentError
        If nothing of the copy fits, or several placements fit equally well.
    """
    meshes = (copy,) if isinstance(copy, MeshAnimation) else tuple(copy)
    if not original.constant_topology:
        raise AlignmentError(
            "the connectivity of the original changes over time",
            source=original.origin,
            prim=original.prim,
        )
    search = _Search(meshes, original)
    method, placement = search.first(frames)
    placed = []
    for index in frames:
        found = search.follow(index, method, placement)
        if found is not None:
            placed.append(found)
    if not placed:
        raise AlignmentError("no frame of the copy fits", source=meshes[0].origin)
    return MeshAlignment(meshes, original, method, tuple(placed))


@dataclass(frozen=True, eq=False)
class _Fit:
    placement: Placement
    rest: Rest

    @property
    def residual(self) -> float:
        distances = np.sort(self.rest.distances)[: max(1, round(KEPT * len(self.rest.distances)))]
        return float(np.sqrt((distances**2).mean()))

    @property
    def fits(self) -> bool:
        near = self.rest.agree & (self.rest.distances < NEAR)
        return self.residual < FITS and float(near.mean()) >= MOST_NEAR


class _Search:
    def __init__(self, meshes: tuple[MeshAnimation, ...], original: MeshAnimation) -> None:
        self._meshes, self._original = meshes, remembered(original)
        first = original[0]
        self._diagonal, self._centre = surface_box(first.points, first.faces)
        self._n_points = first.topology.n_points

    @cached_property
    def _samples(self) -> PoseSamples:
        return PoseSamples(self._original)

    @cached_property
    def _vertices(self) -> tuple[IntArray, FloatArray]:
        """Some vertices of the original, and where they are in the sampled poses."""
        used = np.unique(self._original[0].faces)
        some = used[spread(len(used), ROUGH)]
        return some, np.stack([self._original[int(k)].points[some] for k in self._samples.poses])

    def first(self, frames: Sequence[int]) -> tuple[str, Placement]:
        reason = "no frame of the copy can be read"
        for index in [frames[i] for i in spread(len(frames), TRIED)]:
            frame = CopyFrame.of(self._meshes, index)
            for method in ("identity", "pca"):
                fit = self._place(frame, method)
                if fit is not None and fit.fits:
                    return method, fit.placement
                if fit is not None:
                    reason = f"the best placement leaves {fit.residual:.2%} of the diagonal"
        raise AlignmentError(reason, source=self._meshes[0].origin, prim=self._meshes[0].prim)

    def follow(self, index: int, method: str, near: Placement) -> FramePlacement | None:
        frame = CopyFrame.of(self._meshes, index)
        fit = self._near(frame, near) if method == "pca" else self._place(frame, method)
        if fit is None or not fit.fits:
            fit = self._place(frame, method)
        if fit is None or not fit.fits:
            return None
        covered = self._covered(frame, fit.placement)
        if covered < LEAST_COVERED:
            return None
        matcher = self._matcher(frame, method)(fit.placement.pose)
        maps = maps_of(frame.points, fit.placement, matcher, covered)
        return FramePlacement(index, fit.placement.pose, maps, fit.residual, covered)

    def _place(self, frame: CopyFrame, method: str) -> _Fit | None:
        return self._by_identity(frame) if method == "identity" else self._by_axes(frame)

    def _by_identity(self, frame: CopyFrame) -> _Fit | None:
        if frame.n_points != self._n_points:
            return None
        some, where = self._vertices
        slot = np.searchsorted(frame.vertices, some)
        slot = np.minimum(slot, len(frame.vertices) - 1)
        there = frame.vertices[slot] == some
        if there.sum() < 4:
            return None
        X, Y = frame.points[slot[there]], where[:, there]
        at = int(misfits(X, Y).argmin())
        pose = float(self._samples.poses[at])
        everywhere = self._original[int(pose)].points[frame.vertices]
        start = Placement(robust_similarity(frame.points, everywhere), pose)
        return self._exact(frame, start, "identity")

    def _by_axes(self, frame: CopyFrame) -> _Fit | None:
        samples, own = self._samples, Moments(frame.points, frame.faces)
        if own.radius == 0.0:
            return None
        rng = np.random.default_rng(0)
        P = sample_surface(frame.points, frame.faces, 300, rng)
        best: list[tuple[float, Placement]] = []
        for signs in _SIGNS:
            found = []
            for at, there in enumerate(samples.moments):
                R = there.radius / own.radius * (there.axes * signs) @ own.axes.T
                A = np.column_stack([R, there.centre - R @ own.centre])
                start = Placement(A, float(samples.poses[at]))
                found.append((samples.misfit(start(P), at), start))
            best.append(min(found, key=lambda each: each[0]))
        few = frame.some(ROUGH)
        rough = [self._fit(few, start, "pca", 12, False) for _, start in sorted(best, key=_first)]
        rough.sort(key=lambda fit: fit.residual)
        return min(
            (self._exact(frame, fit.placement, "pca") for fit in rough[:2]),
            key=lambda fit: fit.residual,
        )

    def _near(self, frame: CopyFrame, near: Placement) -> _Fit:
        samples = self._samples
        P = sample_surface(frame.points, frame.faces, 300, np.random.default_rng(0))
        pose = float(samples.poses[samples.nearest(near(P))])
        rough = self._fit(frame.some(ROUGH), Placement(near.A, pose), "pca", 8, True)
        return self._exact(frame, rough.placement, "pca")

    def _exact(self, frame: CopyFrame, start: Placement, method: str) -> _Fit:
        return self._fit(frame.some(MOST_VERTICES), start, method, 30, True)

    def _fit(
        self, frame: CopyFrame, start: Placement, method: str, rounds: int, free_pose: bool
    ) -> _Fit:
        refinement = Refinement(
            frame.points,
            frame.normals,
            self._matcher(frame, method),
            len(self._original),
            self._centre,
            self._diagonal,
        )
        found = refinement.refine(start, rounds, free_pose)
        return _Fit(found, refinement.rest(found))

    def _matcher(self, frame: CopyFrame, method: str) -> _MatcherAt:
        return _MatcherAt(self._original, frame.vertices if method == "identity" else None)

    def _covered(self, frame: CopyFrame, placement: Placement) -> float:
        there = posed(self._original, placement.pose)
        samples = sample_surface(there.points, there.faces, 2000, np.random.default_rng(0))
        X = placement(frame.points)
        apart = np.sqrt(face_areas(X, frame.faces).sum() / len(X))
        reach = max(NEAR * self._diagonal, 2.0 * float(apart))
        distance, _ = cKDTree(X).query(samples)
        return float((distance < reach).mean())


@dataclass(frozen=True, eq=False)
class _MatcherAt:
    original: MeshAnimation
    vertices: IntArray | None

    def __call__(self, pose: float) -> Matcher:
        if self.vertices is None:
            return ByClosestPoint(self.original, pose)
        return ByIdentity(self.original, pose, self.vertices)


_SIGNS = [np.array([i, j, k]) for i in (1.0, -1.0) for j in (1.0, -1.0) for k in (1.0, -1.0)]


def _first(pair: tuple[float, Placement]) -> float:
    return pair[0]
