"""Where a leaked copy lies on its original."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.fit import Fit, better
from meshmark.alignment.following import FollowFrame
from meshmark.alignment.original import Original
from meshmark.alignment.pieces import joined, pieces
from meshmark.alignment.placement import AssetAlignment, MeshAlignment
from meshmark.alignment.refinement import Placement
from meshmark.alignment.search import DIFFERENT, FEATURES, IDENTITY, PCA, REPOSED, Search
from meshmark.arrays import FloatArray
from meshmark.errors import AlignmentError, MeshmarkError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, LeftOut
from meshmark.mesh.breakdown import breakdown_means_no_capacity
from meshmark.mesh.frame_range import frames_in, in_range, spread
from meshmark.workers.ordered_map import ordered_map
from meshmark.workers.pool import one_thread

FRAMES = 12
# Meshes of the copy that features, which take long, are tried on, for each of the original's.
MOST_BY_FEATURES = 2
# Points of a mesh that tell whether it may lie somewhere, and the share that must lie near there.
FEW, LEAST_INSIDE = 100, 0.3


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
        Processes that work, this one among them.

    Returns
    -------
    AssetAlignment

    Raises
    ------
    UsageError
        If no mesh of the copy has a frame in the range.

    Notes
    -----
    Large meshes are looked for first: where they are found, others are looked for first. A mesh
    of the copy belongs to one mesh of the original, or, if several were joined, each of its pieces
    does.
    """
    inside, _ = in_range(copy, frames)
    work = _Work(inside.meshes, original.meshes, frames, n_frames, jobs)
    found: dict[int, MeshAlignment] = {}
    unplaced: dict[int, LeftOut] = {}
    sizes = [mesh[0].topology.n_points for mesh in original.meshes]
    for i in sorted(range(len(sizes)), key=lambda i: -sizes[i]):
        mesh = original.meshes[i]
        try:
            with breakdown_means_no_capacity():
                found[i] = work.align(mesh)
        except MeshmarkError as error:
            unplaced[i] = LeftOut(mesh.prim, error.message)
    return AssetAlignment(
        tuple(found[i] for i in sorted(found)), tuple(unplaced[i] for i in sorted(unplaced))
    )


def align_mesh(
    copy: MeshAnimation | Sequence[MeshAnimation],
    original: MeshAnimation,
    frames: Sequence[int],
    *,
    jobs: int = 1,
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
    jobs : int
        Processes that work, this one among them.

    Returns
    -------
    MeshAlignment

    Raises
    ------
    AlignmentError
        If nothing of the copy fits, or several placements fit equally well.
    """
    meshes = (copy,) if isinstance(copy, MeshAnimation) else tuple(copy)
    known = Original(original)
    with breakdown_means_no_capacity(), one_thread():
        method, fit = Search(meshes, known).first(frames, (IDENTITY, REPOSED, PCA, FEATURES))
    return _follow(meshes, known, method, fit.placement, frames, jobs)


def _follow(
    meshes: Sequence[MeshAnimation],
    original: Original,
    method: str,
    start: Placement,
    frames: Sequence[int],
    jobs: int,
) -> MeshAlignment:
    follow = FollowFrame(meshes, original, method, start)
    with one_thread():
        placed = tuple(each for each in ordered_map(follow, frames, jobs=jobs) if each is not None)
    if not placed:
        raise AlignmentError(
            "no frame of the copy fits", source=meshes[0].origin, prim=meshes[0].prim
        )
    return MeshAlignment(tuple(meshes), original.animation, method, placed)


class _Work:
    """The meshes of a copy that are left, and where meshes of the original were found."""

    def __init__(
        self,
        meshes: Sequence[MeshAnimation],
        originals: Sequence[MeshAnimation],
        frames: str | None,
        n_frames: int,
        jobs: int,
    ) -> None:
        self._free, self._known = list(meshes), list[Placement]()
        self._originals, self._points = originals, dict[MeshAnimation, FloatArray]()
        self._range, self._n_frames, self._jobs = frames, n_frames, jobs
        # Where the original is one mesh, what was joined to its copy may stay there.
        self._all_tried = len(originals) == 1
        if len(originals) > 1:
            topologies = [mesh[0].topology for mesh in originals]
            sizes = [(each.n_points, len(each.triangles)) for each in topologies]
            self._free = [piece for mesh in meshes for piece in pieces(mesh, sizes)]

    def align(self, mesh: MeshAnimation) -> MeshAlignment:
        original = Original(mesh)
        with one_thread():
            found = self._found(original)
        aligned = _follow(
            found.meshes,
            original,
            found.method,
            found.start,
            self._frames(found.meshes),
            self._jobs,
        )
        self._free = [each for each in self._free if each not in found.meshes]
        self._remember(found, original)
        return aligned

    def _found(self, original: Original) -> _Found:
        reason = "nothing of the copy is left for it"
        best: tuple[_Found, Fit] | None = None
        for meshes, method in self._candidates(original):
            if method == REPOSED and best is not None:
                continue
            if method == PCA and best is None:
                known = self._where_others_are(original)
                if known is not None:
                    return known
            search, frames = Search(meshes, original), self._frames(meshes)
            try:
                _, fit = search.first(frames, (method,))
            except AlignmentError as error:
                reason = error.message
                continue
            if best is None or better(fit, best[1]):
                best = _Found(meshes, method, fit.placement), fit
            if fit.is_good:
                break
        if best is None:
            raise AlignmentError(reason)
        if best[0].method in (IDENTITY, REPOSED):
            return best[0]
        return self._with_others(best[0], original)

    def _candidates(self, original: Original) -> Iterator[tuple[tuple[MeshAnimation, ...], str]]:
        """List what of the copy the original may be found in, and how: quick and likely first."""
        free = sorted(self._free, key=lambda each: each.prim != original.animation.prim)
        same = [mesh for mesh in free if mesh[0].topology.n_points == original.n_points]
        yield from (((mesh,), method) for method in (IDENTITY, REPOSED) for mesh in same)
        by_mesh: dict[str, tuple[MeshAnimation, ...]] = {}
        for piece in free:
            by_mesh[piece.prim] = (*by_mesh.get(piece.prim, ()), piece)
        alone = list(by_mesh.values())
        together = [tuple(free)] if len(alone) > 1 else []
        apart = [(piece,) for piece in free if len(by_mesh[piece.prim]) > 1]
        several = [*alone[:1], *together, *alone[1:], *apart]
        yield from ((meshes, PCA) for meshes in several)
        yield from ((meshes, FEATURES) for meshes in several[:MOST_BY_FEATURES])

    def _where_others_are(self, original: Original) -> _Found | None:
        """Look where other meshes of the original were found, or all of it together is."""
        self._place_all()
        for start in self._known:
            lying = self._lying(start, original)
            if lying:
                return _Found(lying, PCA, start)
        return None

    def _place_all(self) -> None:
        """Place all of the copy on all of the original, if that was not tried before."""
        if self._all_tried or self._known or not self._free:
            return
        self._all_tried = True
        whole = joined(self._originals)
        if whole is None:
            return
        search = Search(self._free, Original(whole))
        try:
            _, fit = search.first(self._frames(self._free), (IDENTITY, PCA))
        except MeshmarkError:
            return
        self._known.append(fit.placement)

    def _remember(self, found: _Found, original: Original) -> None:
        """Keep a placement that none before is like."""
        frame = self._frames(found.meshes)[0]
        P = CopyFrame.of(found.meshes, frame).points
        apart = (np.abs(found.start(P) - known(P)).max() for known in self._known)
        if all(each > DIFFERENT * original.diagonal for each in apart):
            self._known.append(found.start)

    def _with_others(self, found: _Found, original: Original) -> _Found:
        """Add meshes that lie on the original as well, and leave out those that do not."""
        if len(found.meshes) == 1:
            others = self._lying(found.start, original, besides=found.meshes)
            return _Found((*found.meshes, *others), found.method, found.start)
        lying = self._lying(found.start, original)
        return _Found(lying or found.meshes, found.method, found.start)

    def _lying(
        self, start: Placement, original: Original, besides: tuple[MeshAnimation, ...] = ()
    ) -> tuple[MeshAnimation, ...]:
        """List the meshes that lie on an original under a placement."""
        return tuple(
            mesh
            for mesh in self._free
            if mesh not in besides
            and original.samples.may_hold(start(self._few_points(mesh)), LEAST_INSIDE)
            and Search((mesh,), original).known(self._frames((mesh,)), [start]) is not None
        )

    def _few_points(self, mesh: MeshAnimation) -> FloatArray:
        """Read some points of a mesh of the copy once, (n, 3); none if it cannot be read."""
        if mesh not in self._points:
            try:
                frame = CopyFrame.of((mesh,), self._frames((mesh,))[0])
                self._points[mesh] = frame.some(FEW).points
            except MeshmarkError:
                self._points[mesh] = np.empty((0, 3))
        return self._points[mesh]

    def _frames(self, meshes: Sequence[MeshAnimation]) -> list[int]:
        inside = frames_in(meshes[0], self._range)
        return [inside[i] for i in spread(len(inside), self._n_frames)]


@dataclass(frozen=True, eq=False)
class _Found:
    meshes: tuple[MeshAnimation, ...]
    method: str
    start: Placement
