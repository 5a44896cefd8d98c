"""Blind extraction: from a leaked animation to evidence, with no key and no original."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

from meshmark.animation import MeshAnimation
from meshmark.carrier import Carrier, Chips, measure
from meshmark.errors import CapacityError
from meshmark.evidence import Evidence
from meshmark.interfaces import Scheme
from meshmark.parallel import ordered_map
from meshmark.welding import Welding

FloatArray = NDArray[np.float64]
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Sighting:
    """The carriers of one frame: their chips, and the shapes they are told apart by."""

    chips: Chips
    descriptors: FloatArray


@dataclass(frozen=True, eq=False)
class Tracked:
    """Measures frames whose vertices keep their identity: one layout serves them all."""

    animation: MeshAnimation
    scheme: Scheme
    welding: Welding
    layout: Any

    def __call__(self, index: int) -> Sighting:
        """Measure frame `index`."""
        frame = self.welding.frame(self.animation[index])
        return _sight(self.scheme.carriers(frame, self.layout))


@dataclass(frozen=True, eq=False)
class Untracked:
    """Measures frames whose connectivity changes: each is laid out by itself."""

    animation: MeshAnimation
    scheme: Scheme

    def __call__(self, index: int) -> Sighting | None:
        """Measure frame `index`; None if nothing is found in it."""
        frame = self.animation[index]
        try:
            analysed = Welding.of(frame).frame(frame)
            return _sight(self.scheme.carriers(analysed, self.scheme.layout(analysed)))
        except CapacityError:
            return None


def _sight(carriers: Sequence[Carrier]) -> Sighting:
    return Sighting(measure(carriers), np.array([carrier.descriptor for carrier in carriers]))


def extract(
    animation: MeshAnimation,
    scheme: Scheme,
    scheme_name: str,
    *,
    frames: tuple[int, ...] | None = None,
    jobs: int = 1,
    progress: Progress | None = None,
) -> Evidence:
    """Measure the evidence of one mesh.

    Parameters
    ----------
    frames : tuple of int, optional
        Indices of the frames to look at; all by default.

    Raises
    ------
    CapacityError
        If the scheme finds no carrier.
    InputError
        If a frame cannot be read.
    """
    chosen = tuple(range(len(animation))) if frames is None else frames
    try:
        work = _observer(animation, scheme, chosen[0])
        found: list[Sighting | None] = []
        for sighting in ordered_map(work, chosen, jobs=jobs):
            found.append(sighting)
            if progress is not None:
                progress(len(found), len(chosen))
        # Trajectories keep carriers in one order; matching alike ones could only mix them up.
        chips = (
            [sighting.chips for sighting in found if sighting is not None]
            if animation.constant_topology
            else aligned(found)
        )
    except CapacityError as error:
        raise CapacityError(error.message, source=animation.origin, prim=animation.prim) from None
    return Evidence(
        prim=animation.prim,
        scheme=scheme_name,
        n_words=scheme.n_words,
        times=animation.times[list(chosen)],
        value=np.array([item.value for item in chips]),
        held=np.array([item.held for item in chips]),
        strength=scheme.strength,
        tracked=animation.constant_topology,
    )


def _observer(
    animation: MeshAnimation, scheme: Scheme, first: int
) -> Callable[[int], Sighting | None]:
    if not animation.constant_topology:
        return Untracked(animation, scheme)
    frame = animation[first]
    welding = Welding.of(frame)
    return Tracked(animation, scheme, welding, scheme.layout(welding.frame(frame)))


def aligned(sightings: Sequence[Sighting | None]) -> list[Chips]:
    """Put the carriers of every frame into the order of the frame that shows the most.

    Carriers are matched by their descriptors, one to one, at the least total difference. That
    needs no key, so a wrong match costs evidence but never honesty.

    Returns
    -------
    list of Chips
        All of the same shape; a carrier missing from a frame is all erasures there.

    Raises
    ------
    CapacityError
        If no frame shows any carrier.
    """
    seen = [sighting for sighting in sightings if sighting is not None]
    if not seen:
        raise CapacityError("no carrier is found in any frame")
    reference = max(seen, key=lambda sighting: len(sighting.descriptors))
    return [_align(sighting, reference) for sighting in sightings]


def _align(sighting: Sighting | None, reference: Sighting) -> Chips:
    value = np.zeros_like(reference.chips.value)
    count = np.zeros_like(reference.chips.count)
    if sighting is not None:
        cost = cdist(sighting.descriptors, reference.descriptors)
        own, theirs = linear_sum_assignment(cost)
        value[theirs], count[theirs] = sighting.chips.value[own], sighting.chips.count[own]
    return Chips(value, count)
