"""The placement of one frame of a copy, from nothing or near to a known one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from meshmark.alignment.axes import by_axes
from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.features import by_features
from meshmark.alignment.fit import (
    ALIKE,
    FITS,
    FITS_PAIRED,
    KEPT,
    MOST,
    NEAR,
    NOWHERE,
    REACH,
    Fit,
    alike,
    best_of,
    better,
    misfit,
    shortfall,
)
from meshmark.alignment.matching import ClosestAt, Matcher, PairedAt, SamplesAt
from meshmark.alignment.new_poses import by_reposing, joints_fit_better
from meshmark.alignment.original import Original
from meshmark.alignment.poses import posed
from meshmark.alignment.procrustes import robust_similarity
from meshmark.alignment.refinement import Placement, Refinement, Rest
from meshmark.errors import AlignmentError, MeshmarkError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.frame_range import spread
from meshmark.mesh.geometry import edge_length, face_areas, lengths

IDENTITY, REPOSED, PCA, FEATURES = "identity", "reposed", "pca", "features"
# Vertices that rough and exact placements are computed from, at most, and their rounds.
ROUGH, ROUGH_ROUNDS = 600, 12
EXACT, EXACT_ROUNDS = 4_000, 30
# Vertices that tell how well a placement fits, at most.
TELLING = 12_000
# Vertices cover what is nearer than this quantile of edges is long.
LONG = 0.95
# Below, vertices slide along the surface: the closest points tell more of it than theirs.
SLIDES = 0.1
# Poses that a frame near to a known placement may start from.
POSES = 4
# Frames that are tried before nothing fits, and separate surfaces of a frame.
TRIED, PARTS = 3, 4
# Rough placements that are told apart, and made exact.
TOLD_APART, MADE_EXACT = 8, 2
# Placements that differ by more than this share of the diagonal are not the same.
DIFFERENT = 0.02


class Search:
    """Places frames of a copy on one mesh of the original; pickles.

    Parameters
    ----------
    meshes : sequence of MeshAnimation
        Of the copy, read as one.
    original : Original
    """

    def __init__(self, meshes: Sequence[MeshAnimation], original: Original) -> None:
        self._meshes, self._original = tuple(meshes), original

    def first(self, frames: Sequence[int], methods: Sequence[str]) -> tuple[str, Fit]:
        """Place one of some frames from nothing: the first, one in the middle or the last.

        Returns
        -------
        method : str
            The one by which it succeeds.
        fit : Fit

        Raises
        ------
        AlignmentError
            If no placement fits, or several do alike.
        """
        reason = NOWHERE
        tried = [frames[i] for i in spread(len(frames), TRIED)]
        best: tuple[str, Fit] | None = None
        for method in methods:
            if method == REPOSED and best is not None and best[1].fits:
                continue
            for index in tried[: 1 if method == FEATURES else TRIED]:
                try:
                    fit = self.place(CopyFrame.of(self._meshes, index), method)
                except MeshmarkError as error:
                    reason = error.message
                    continue
                if fit is not None and (best is None or better(fit, best[1])):
                    best = method, fit
                if fit is None or fit.fits:
                    break
            if best is not None and best[1].is_good:
                break
        if best is not None and best[1].fits:
            return best
        raise AlignmentError(
            reason if best is None else shortfall(best[1]),
            source=self._meshes[0].origin,
            prim=self._meshes[0].prim,
        )

    def known(self, frames: Sequence[int], starts: Iterable[Placement]) -> Placement | None:
        """Tell under which of the placements that were found for other meshes these fit, too.

        A remnant will do: what lies on the original there is part of it.
        """
        try:
            frame = CopyFrame.of(self._meshes, frames[0])
        except MeshmarkError:
            return None
        for start in starts:
            if not self._original.samples.may_hold(start(frame.points), MOST):
                continue
            fit = self.near(frame, start)
            X, Y = fit.placement(frame.points), start(frame.points)
            apart = np.linalg.norm(X - Y, axis=1).mean() / self._original.diagonal
            if fit.near >= MOST and fit.residual < FITS and apart < DIFFERENT:
                return fit.placement
        return None

    def place(self, frame: CopyFrame, method: str) -> Fit | None:
        """Place a frame from nothing; None if the method does not apply.

        Raises
        ------
        AlignmentError
            If several placements fit equally well.
        """
        if method == IDENTITY:
            return self._by_identity(frame)
        if method == REPOSED:
            return by_reposing(frame, self._original, self._meshes[0][0].topology)
        if method == PCA:
            return self._by_axes(frame)
        return self._by_features(frame)

    def near(self, frame: CopyFrame, start: Placement) -> Fit:
        """Place a frame whose similarity, but not its pose, is about that of another."""
        samples = self._original.samples
        # Vertices: a large plane that was joined has much area, but few of them.
        some = frame.some(ROUGH)
        poses = samples.nearest(start(some.points), POSES)
        rough = [self._rough(some, Placement(start.A, pose), REACH) for pose in poses]
        return self._exact(frame, min(rough, key=misfit).placement)

    def _by_identity(self, frame: CopyFrame) -> Fit | None:
        original = self._original
        pose = original.pose_of(frame) if frame.n_points == original.n_points else None
        if pose is None:
            return None
        some = frame.some(EXACT)
        there = posed(original.animation, pose).points[some.vertices]
        start = Placement(robust_similarity(some.points, there), pose)
        apart = np.linalg.norm(start(some.points) - there, axis=1) / original.diagonal
        if not np.quantile(apart, KEPT) < 2.0 * FITS_PAIRED:
            return None
        found, rest = self._refined(some, start, PairedAt(original, some), EXACT_ROUNDS)
        if np.quantile(rest.distances, KEPT) > FITS_PAIRED:
            return None
        if rest.slip < SLIDES:
            found, _ = self._refined(some, found, ClosestAt(original), EXACT_ROUNDS)
        fit = self._fit(frame, found, rest.slip)
        topology = self._meshes[0][0].topology
        return None if joints_fit_better(frame, original, topology, fit) else fit

    def _by_axes(self, frame: CopyFrame) -> Fit | None:
        best = None
        for part in (frame, *frame.parts(PARTS)):
            best = best_of(best, self._best(part, by_axes(part, self._original.samples)))
            if best is not None and best.is_good:
                break
        return best

    def _by_features(self, frame: CopyFrame) -> Fit | None:
        original = self._original
        first = original.animation[0]
        area = float(face_areas(first.points, first.faces).sum())
        edge = edge_length(first.points, first.faces)
        best = None
        for part in [frame, *frame.parts(1)]:
            for starts in by_features(part, original.samples, original.diagonal, area, edge):
                best = best_of(best, self._best(part, starts))
                if best is not None and best.fits:
                    return best
        return best

    def _best(self, frame: CopyFrame, starts: Iterable[Placement]) -> Fit | None:
        """Make the best of rough placements exact."""
        rough = sorted((self._rough(frame, start) for start in starts), key=misfit)
        if not rough:
            return None
        best = min((self._exact(frame, fit.placement) for fit in rough[:MADE_EXACT]), key=misfit)
        if not best.fits:
            return best
        turned = [self._rough_fit(frame.some(ROUGH), each) for each in self._turned(best)]
        return self._unambiguous(frame, best, [*rough[:TOLD_APART], *turned])

    def _turned(self, best: Fit) -> list[Placement]:
        """Turn a placement about the middle of the original: starts may all lie on one side."""
        A, pose, centre = best.placement.A, best.placement.pose, self._original.centre
        turns = Rotation.create_group("O").as_matrix()[1:]
        return [
            Placement(np.column_stack([R @ A[:, :3], R @ (A[:, 3] - centre) + centre]), pose)
            for R in turns
        ]

    def _unambiguous(self, frame: CopyFrame, best: Fit, others: Sequence[Fit]) -> Fit:
        """Refuse what fits in several places alike; of a mirror image, take the shape itself."""
        some, original = frame.some(ROUGH), self._original
        own = np.minimum(self._rough_fit(some, best.placement).distances, NEAR)
        # A body has one mirror image; what has several can be turned, too.
        taken = [best.placement(some.points)]
        for other in others:
            # Worse than this before it has converged, it is no rival.
            if other.misfit > FITS + ALIKE * best.misfit:
                continue
            refinement = self._refinement(some, ClosestAt(original), REACH)
            found = refinement.refine(other.placement, EXACT_ROUNDS, free_pose=False)
            Y = found(some.points)
            apart = [lengths(Y - X).mean() / original.diagonal for X in taken]
            theirs = np.minimum(self._rough_fit(some, found).distances, NEAR)
            if min(apart) < DIFFERENT or not alike(own, theirs):
                continue
            if best.placement.mirrors and not found.mirrors:
                return self._unambiguous(frame, self._exact(frame, found), others)
            if found.mirrors and len(taken) == 1:
                taken.append(Y)
                continue
            raise AlignmentError(
                "the copy fits in several places equally well, as symmetric shapes do",
                source=self._meshes[0].origin,
                prim=self._meshes[0].prim,
            )
        return best

    def _rough(self, frame: CopyFrame, start: Placement, reach: float = np.inf) -> Fit:
        some = frame.some(ROUGH)
        refinement = self._refinement(some, SamplesAt(self._original), reach)
        found = refinement.refine(start, ROUGH_ROUNDS, free_pose=False)
        found = refinement.refine(found, ROUGH_ROUNDS)
        return self._rough_fit(some, found)

    def _rough_fit(self, some: CopyFrame, placement: Placement) -> Fit:
        rest = self._refinement(some, ClosestAt(self._original), np.inf).rest(placement)
        extent = np.linalg.norm(np.ptp(placement(some.points), axis=0)) / self._original.diagonal
        return Fit(placement, rest.distances, extent=float(extent))

    def _exact(self, frame: CopyFrame, start: Placement) -> Fit:
        at = ClosestAt(self._original)
        found, _ = self._refined(frame.some(EXACT), start, at, EXACT_ROUNDS, REACH)
        return self._fit(frame, found)

    def _fit(self, frame: CopyFrame, placement: Placement, slip: float = 0.0) -> Fit:
        some, original = frame.some(TELLING), self._original
        rest = self._refinement(some, ClosestAt(original), np.inf).rest(placement)
        lies = rest.agree & (rest.distances < NEAR)
        if lies.sum() < 4:
            return Fit(placement, rest.distances)
        X = placement(some.points[lies])
        scale = np.cbrt(abs(np.linalg.det(placement.A[:, :3])))
        longest = scale * edge_length(frame.points, frame.faces, LONG)
        reach = max(NEAR * original.diagonal, longest)
        distance, _ = cKDTree(X).query(original.surface_samples(placement.pose, 2000))
        return Fit(
            placement,
            rest.distances,
            float(lies.mean()),
            float((distance < reach).mean()),
            float(np.linalg.norm(np.ptp(X, axis=0))) / original.diagonal,
            slip,
        )

    def _refined(
        self,
        frame: CopyFrame,
        start: Placement,
        matcher_at: Callable[[float], Matcher],
        rounds: int,
        reach: float = np.inf,
    ) -> tuple[Placement, Rest]:
        refinement = self._refinement(frame, matcher_at, reach)
        found = refinement.refine(start, rounds)
        return found, refinement.rest(found)

    def _refinement(
        self, frame: CopyFrame, matcher_at: Callable[[float], Matcher], reach: float
    ) -> Refinement:
        original = self._original
        return Refinement(
            frame.points,
            frame.normals,
            matcher_at,
            len(original.animation),
            original.centre,
            original.diagonal,
            reach,
        )
