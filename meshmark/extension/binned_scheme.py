"""Binned schemes as all others: carriers that follow vertices, marked by the closed loop."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshmark.arrays import IntArray
from meshmark.errors import CapacityError, NoLayoutError
from meshmark.extension.carrier import Observation, observation_of
from meshmark.extension.closed_loop import ClosedLoopPlan, settle
from meshmark.extension.interfaces import BinnedScheme, Scheme
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.breakdown import breakdown_means_no_capacity


def as_scheme(made: Scheme | BinnedScheme) -> Scheme:
    """Return what detection and embedding work with: a binned scheme in its `ClosedLoopScheme`."""
    return ClosedLoopScheme(made) if isinstance(made, BinnedScheme) else made


class ClosedLoopScheme:
    """A `Scheme` made of a binned one.

    Parameters
    ----------
    binned : BinnedScheme
        Says where carriers are, and how vertices move.
    """

    restorations: tuple[int, ...] = (0,)
    follows_vertices = True

    def __init__(self, binned: BinnedScheme) -> None:
        self.binned = binned
        self.n_chips, self.n_words = binned.n_chips, binned.n_words
        # The last frame that a layout was asked of, and that layout.
        self._known: tuple[Frame, Any] | None = None

    def __getstate__(self) -> dict[str, Any]:
        # What is remembered stays in the process that measured it.
        return {**vars(self), "_known": None}

    def observe(self, frame: Frame, reference: Frame | None = None) -> Observation:
        """Measure the carriers of the layout of `reference`, or else of the frame's own.

        Raises
        ------
        NoLayoutError
            If `reference` has no layout.
        CapacityError
            If the frame has none, or lacks a carrier of it.
        """
        layout = self.binned.layout(frame) if reference is None else self._layout_of(reference)
        return observation_of(self.binned.carriers(frame, layout), self.binned.strength)

    def require_capacity(self, animation: MeshAnimation, *, jobs: int = 1) -> None:
        """Refuse an animation whose first frame has no layout."""
        self._layout_of(animation[0])

    def plan(
        self,
        animation: MeshAnimation,
        words: IntArray,
        *,
        generator: np.random.Generator,
        step: float,
        jobs: int = 1,
    ) -> ClosedLoopPlan:
        """Find the layout of the first frame that is to be marked in all."""
        return settle(animation[0], self.binned, words, generator, step)

    def _layout_of(self, reference: Frame) -> Any:
        """Find the layout of a frame; it is asked for with every frame that is measured."""
        if self._known is None or not _same(self._known[0], reference):
            try:
                with breakdown_means_no_capacity():
                    self._known = reference, self.binned.layout(reference)
            except CapacityError as error:
                raise NoLayoutError(error.message) from None
        return self._known[1]


def _same(one: Frame, two: Frame) -> bool:
    return one is two or (
        one.topology.same_as(two.topology) and np.array_equal(one.points, two.points)
    )
