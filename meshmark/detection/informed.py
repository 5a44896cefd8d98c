"""Informed extraction: from a copy and its original to evidence, with no key involved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from meshmark.alignment.align import align_mesh
from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.in_place import in_place
from meshmark.alignment.joints import moved_by_joints
from meshmark.alignment.placement import FramePlacement, MeshAlignment
from meshmark.alignment.poses import motion, posed
from meshmark.alignment.reposing import reposed
from meshmark.alignment.search import IDENTITY, REPOSED
from meshmark.arrays import FloatArray, IntArray
from meshmark.detection.evidence import Evidence, InformedFacts, RestoredVariant
from meshmark.detection.informed_pairs import aligned, pairs, run_named
from meshmark.detection.original_layout import OriginalLayout
from meshmark.detection.vertex_evidence import VertexEvidence
from meshmark.errors import CapacityError, UsageError
from meshmark.extension.informed import AlignedFrame, InformedScheme, VertexReader
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.breakdown import breakdown_means_no_capacity
from meshmark.mesh.geometry import vertex_normals
from meshmark.mesh.skinning import Skinning
from meshmark.workers.ordered_map import ordered_map
from meshmark.workers.pool import one_thread
from meshmark.workers.progress import MeshProgress


@dataclass(frozen=True, eq=False)
class InformedEvidence:
    """What a copy says beside its original, before any key is tried.

    Parameters
    ----------
    items : tuple of Evidence
        One for each mesh of the original that lies in the copy, and each scheme.
    notes : tuple of str
        What could not be read, and why.
    """

    items: tuple[Evidence, ...]
    notes: tuple[str, ...]


def gather_informed(
    copy: Asset,
    original: Asset,
    recipes: Sequence[Recipe],
    *,
    master: Asset | None = None,
    frames: str | None = None,
    points_in_place: float | None = None,
    jobs: int = 1,
    progress: MeshProgress | None = None,
) -> InformedEvidence:
    """Measure a copy against its original by every informed scheme.

    Parameters
    ----------
    copy, original : Asset
        The suspicious copy, and what it may have been made from.
    recipes : sequence of Recipe
        Informed schemes.
    master : Asset, optional
        The original as the blind layers left it: copies are then compared with that.
    frames : str, optional
        Range A:B[:S] of the copy's time codes; some of them are read, see `aligned`.
    points_in_place : float, optional
        Of a copy that was written just now, and that nobody had since: how many points of each
        mesh are to be read, in a few frames at least; see `in_place`.

    Raises
    ------
    UsageError
        If the master is not made from the original.
    InputError
        If a frame cannot be read.
    """
    masters = {} if master is None else _by_prim(original, master)
    notes: list[str] = []
    items: list[Evidence] = []
    for pair in pairs(copy, original, frames):
        alignment = None
        if points_in_place is not None:
            alignment = in_place(pair.copy, pair.original, points_in_place / pair.share)
        untouched = alignment is not None
        if alignment is None:
            alignment = aligned(pair, copy, original, frames=frames, jobs=jobs)
        where = f", {pair.part}" if pair.part else ""
        notes += [
            f"{each.prim} of the original{where}: {each.reason}" for each in alignment.unplaced
        ]
        for found in alignment.meshes:
            twin = masters.get(found.original.prim)
            reference = found.original if twin is None else pair.reference(twin)
            for recipe in recipes:
                try:
                    with breakdown_means_no_capacity(), one_thread():
                        on = OriginalLayout(found.original, recipe.build())
                        reading = _Reading(found, reference, on, recipe.scheme, untouched)
                        items.append(replace(reading.evidence(jobs, progress), part=pair.part))
                except CapacityError as error:
                    notes.append(f"{found.original.prim}{where}: {recipe.scheme}: {error.message}")
    return InformedEvidence(tuple(items), tuple(notes))


def extract_informed(
    copy: MeshAnimation, original: MeshAnimation, scheme: InformedScheme, scheme_name: str
) -> Evidence:
    """Measure all frames of one mesh against its original by one scheme.

    Raises
    ------
    AlignmentError
        If the copy does not lie on the original.
    CapacityError
        If the original is too small.
    """
    found = align_mesh(copy, original, range(len(copy)))
    with one_thread():
        on = OriginalLayout(original, scheme)
        return _Reading(found, original, on, scheme_name).evidence(1, None)


def beside_original(
    items: Sequence[Evidence], original: Asset, recipes: Sequence[Recipe]
) -> tuple[Evidence, ...]:
    """Give evidence that was measured before what it is read by, of which a file holds nothing."""
    schemes = {recipe.scheme: recipe for recipe in recipes}

    def beside(item: Evidence) -> Evidence:
        if item.vertices is None or item.informed is None:
            return item
        mesh = run_named(original.mesh(item.informed.prim), item.part)
        scheme = schemes[item.scheme].build()
        return replace(item, vertices=replace(item.vertices, on=OriginalLayout(mesh, scheme)))

    return tuple(map(beside, items))


def _by_prim(original: Asset, master: Asset) -> dict[str, MeshAnimation]:
    """Find the master of each mesh of the original that has one."""
    by_prim = {mesh.prim: mesh for mesh in master.meshes}
    found = {mesh.prim: by_prim[mesh.prim] for mesh in original.meshes if mesh.prim in by_prim}
    if not found:
        raise UsageError("the master has no mesh of the original", source=master.source)
    for prim, twin in found.items():
        mesh = original.mesh(prim)
        if len(twin) != len(mesh) or not twin[0].topology.same_as(mesh[0].topology):
            raise UsageError(
                "the master has other frames or faces than the original",
                source=master.source,
                prim=prim,
            )
    return found


@dataclass(frozen=True, eq=False)
class _Reading:
    """Reads one aligned mesh by one scheme; pickles, for workers that take a frame each.

    Parameters
    ----------
    found : MeshAlignment
        Where the copy lies on the original.
    reference : MeshAnimation
        What it is compared with: the original, or the master.
    on : OriginalLayout
        The original as the scheme sees it.
    name : str
        That of the scheme.
    untouched : bool
        Whether the copy is known to be as it was written.
    """

    found: MeshAlignment
    reference: MeshAnimation
    on: OriginalLayout
    name: str
    untouched: bool = False

    def evidence(self, jobs: int, progress: MeshProgress | None) -> Evidence:
        """Observe every placed frame, and put the hypotheses side by side."""
        copy, placed, name = self.found.copy, self.found.frames, self.name
        scheme, layout = self.on.scheme, self.on.layout
        treatment = None
        if not self.untouched:
            # What a program did to one frame it did to all.
            treatment = scheme.treatment(tuple(self._views(placed[0])))
        measure = _Measure(self, treatment)
        measured = []
        for done, each in enumerate(
            ordered_map(measure, placed, jobs=jobs, light=self.untouched), start=1
        ):
            measured.append(each)
            if progress is not None:
                progress(f"{copy[0].prim} by {name}", done, len(placed))
        under_maps = list(zip(*measured, strict=True))
        by_map = [scheme.observe(frames, layout) for frames in under_maps]
        soft = [np.concatenate([each.soft for each in maps]) for maps in zip(*by_map, strict=True)]
        log_prior = np.concatenate([frames[0].log_prior for frames in by_map]) - np.log(len(by_map))
        return Evidence(
            prim=copy[0].prim,
            scheme=name,
            n_words=1,
            times=copy[0].times[[placement.index for placement in placed]],
            variants=(RestoredVariant.of(np.array(soft), log_prior),),
            also=self.found.prims[1:],
            informed=InformedFacts(
                prim=self.found.original.prim,
                poses=tuple(placement.pose for placement in placed),
                maps=self.maps,
                method=self.found.method,
                residual=self.found.residual,
                covered=self.found.covered,
                patches=int(np.any(soft[0], axis=(0, 1)).sum()),
            ),
            vertices=self._vertices(under_maps),
        )

    def _vertices(self, measured: Sequence[Sequence[Any]]) -> VertexEvidence | None:
        """Keep what single vertices tell, if the scheme reads them."""
        if not isinstance(self.on.scheme, VertexReader):
            return None
        steps = self.on.scheme.vertex_steps(measured, self.on.layout)
        return None if steps is None else VertexEvidence(steps, self.on)

    @cached_property
    def maps(self) -> tuple[str, ...]:
        """Maps that every frame has."""
        placed = self.found.frames
        return tuple(name for name in placed[0].maps if all(name in each.maps for each in placed))

    def measure(self, placement: FramePlacement, treatment: Any) -> list[Any]:
        """Measure a frame under every map."""
        with breakdown_means_no_capacity(), one_thread():
            return [self.on.scheme.measure(view, treatment) for view in self._views(placement)]

    def _identities(self, frame: CopyFrame) -> tuple[Any, IntArray | None]:
        """Choose the copy's vertices to read, and tell which of the reference they are."""
        if self.found.method not in (IDENTITY, REPOSED):
            return slice(None), None
        vertices = self.on.welding.new[frame.vertices]
        kept = np.flatnonzero(vertices >= 0)
        return kept, vertices[kept]

    @cached_property
    def _skinning(self) -> Skinning | None:
        """How joints move the reference, if it is known; else the original."""
        found = self.reference.skinning or self.found.original.skinning
        return None if found is None else found.of(self.on.welding.kept)

    def _bent(self, V: FloatArray, Q: FloatArray) -> Iterator[FloatArray]:
        """Bend the reference to a pose that it never takes, in each way that may suit it."""
        if self._skinning is not None:
            V = moved_by_joints(self._skinning, V, Q)
            yield V
        # Joints do not explain blend shapes, nor what other programs make of a rig.
        yield reposed(V, Q, self.on.polygons)

    def _views(self, placement: FramePlacement) -> Iterator[AlignedFrame]:
        """Lay a frame of the copy upon the reference, by one map after the other."""
        kept_points = self.on.welding.kept
        frame = CopyFrame.of(self.found.copy, placement.index)
        pose = posed(self.reference, placement.pose)
        under = Frame(pose.time, pose.points[kept_points], self.on.polygons)
        velocity = motion(self.reference, placement.pose)[kept_points]
        kept, vertices = self._identities(frame)
        for name in self.maps:
            points = placement.maps[name](frame.points)
            normals = vertex_normals(points, frame.faces)
            shown = [(under, velocity)]
            if self.found.method == REPOSED:
                Q = pose.points.copy()
                Q[frame.vertices] = points
                bent = self._bent(under.points, Q[kept_points])
                shown = [(under.moved(V), np.zeros_like(V)) for V in bent]
            for reference, rate in shown:
                yield AlignedFrame(reference, rate, points[kept], normals[kept], vertices)


@dataclass(frozen=True, eq=False)
class _Measure:
    """Measures one frame after the other."""

    reading: _Reading
    treatment: Any

    def __call__(self, placement: FramePlacement) -> list[Any]:
        return self.reading.measure(placement, self.treatment)
