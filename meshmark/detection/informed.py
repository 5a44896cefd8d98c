"""Informed extraction: from a copy and its original to evidence, with no key involved."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from meshmark.alignment.align import align, align_mesh
from meshmark.alignment.copy_frames import CopyFrame
from meshmark.alignment.placement import FramePlacement, MeshAlignment
from meshmark.alignment.poses import motion, posed
from meshmark.detection.evidence import Evidence, InformedFacts, RestoredVariant
from meshmark.errors import CapacityError, UsageError
from meshmark.extension.breakdown import breakdown_means_no_capacity
from meshmark.extension.carrier import Observation
from meshmark.extension.informed import AlignedFrame, InformedScheme, layout_frame
from meshmark.extension.recipe import Recipe
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset
from meshmark.mesh.geometry import vertex_normals
from meshmark.mesh.welding import Welding
from meshmark.workers.pool import one_thread
from meshmark.workers.progress import MeshProgress

# Frames of a copy that are read.
FRAMES = 12


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
        The original as the blind layers left it. It is compared with beside the original.
    frames : str, optional
        Range A:B[:S] of the copy's time codes; `FRAMES` of them are read.

    Raises
    ------
    UsageError
        If the master is not made from the original.
    InputError
        If a frame cannot be read.
    """
    masters = {} if master is None else _masters(original, master)
    alignment = align(copy, original, frames=frames, n_frames=FRAMES, jobs=jobs)
    notes = [f"{each.prim} of the original: {each.reason}" for each in alignment.unplaced]
    items: list[Evidence] = []
    for found in alignment.meshes:
        references = [found.original, *masters.get(found.original.prim, ())]
        for recipe in recipes:
            try:
                with breakdown_means_no_capacity(), one_thread():
                    reading = _Reading.of(found, references, recipe.build())
                    items.append(reading.evidence(recipe.scheme, progress))
            except CapacityError as error:
                notes.append(f"{found.original.prim}: {recipe.scheme}: {error.message}")
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
        return _Reading.of(found, (original,), scheme).evidence(scheme_name, None)


def _masters(original: Asset, master: Asset) -> dict[str, tuple[MeshAnimation, ...]]:
    """Find the master of each mesh, by its prim."""
    by_prim = {mesh.prim: mesh for mesh in master.meshes}
    found: dict[str, tuple[MeshAnimation, ...]] = {}
    for mesh in original.meshes:
        twin = by_prim.get(mesh.prim)
        if twin is None:
            continue
        if len(twin) != len(mesh) or not twin[0].topology.same_as(mesh[0].topology):
            raise UsageError(
                "the master has other frames or faces than the original",
                source=master.source,
                prim=mesh.prim,
            )
        found[mesh.prim] = (twin,)
    if not found:
        raise UsageError("the master has no mesh of the original", source=master.source)
    return found


@dataclass(frozen=True, eq=False)
class _Reading:
    """Reads the frames of one aligned mesh by one scheme."""

    found: MeshAlignment
    references: Sequence[MeshAnimation]
    scheme: InformedScheme
    welding: Welding
    layout: Any

    @classmethod
    def of(
        cls, found: MeshAlignment, references: Sequence[MeshAnimation], scheme: InformedScheme
    ) -> _Reading:
        welding, frame = layout_frame(found.original)
        return cls(found, references, scheme, welding, scheme.layout(frame))

    def evidence(self, name: str, progress: MeshProgress | None) -> Evidence:
        """Observe every placed frame, and put the hypotheses side by side."""
        copy, placed = self.found.copy, self.found.frames
        # What a program did to one frame it did to all.
        views = tuple(self._views(placed[0], self.references[-1]))
        treatment = self.scheme.treatment(views, self.layout)
        soft, log_prior = [], np.zeros(0)
        for done, placement in enumerate(placed):
            if progress is not None:
                progress(f"{copy[0].prim} by {name}", done, len(placed))
            observations = self._observations(placement, treatment)
            soft.append(np.concatenate([each.soft for each in observations]))
            log_prior = np.concatenate([each.log_prior for each in observations])
            log_prior = log_prior - np.log(len(observations))
        return Evidence(
            prim=copy[0].prim,
            scheme=name,
            n_words=1,
            times=copy[0].times[[placement.index for placement in placed]],
            variants=(RestoredVariant.of(np.array(soft), log_prior),),
            also=tuple(mesh.prim for mesh in copy[1:]),
            informed=InformedFacts(
                prim=self.found.original.prim,
                poses=tuple(placement.pose for placement in placed),
                maps=self.maps,
                method=self.found.method,
                residual=self.found.residual,
                covered=self.found.covered,
                patches=int(np.any(soft[0], axis=(0, 1)).sum()),
            ),
        )

    @cached_property
    def maps(self) -> tuple[str, ...]:
        """Maps that every frame has."""
        placed = self.found.frames
        return tuple(name for name in placed[0].maps if all(name in each.maps for each in placed))

    def _observations(self, placement: FramePlacement, treatment: Any) -> list[Observation]:
        return [
            self.scheme.observe(view, self.layout, treatment)
            for reference in self.references
            for view in self._views(placement, reference)
        ]

    def _views(self, placement: FramePlacement, reference: MeshAnimation) -> Iterator[AlignedFrame]:
        """Lay a frame of the copy upon a reference, by one map after the other."""
        frame = CopyFrame.of(self.found.copy, placement.index)
        under = self.welding.frame(posed(reference, placement.pose))
        velocity = motion(reference, placement.pose)[self.welding.kept]
        for name in self.maps:
            points = placement.maps[name](frame.points)
            yield AlignedFrame(under, velocity, points, vertex_normals(points, frame.faces))
