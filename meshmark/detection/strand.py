"""Strands of evidence: a mesh over its frames, under one hypothesis of what was done to it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray
from meshmark.detection.evidence import Made
from meshmark.statistics.word_windows import Placement, together

# Evidence is kept in steps of 1 / 127, an eighth of the room: whoever is judged by it is judged
# by the rounded numbers, which are as independent of the key as the others.
STEPS = 127


@dataclass(frozen=True, eq=False)
class FrameEvidence:
    """What one frame says.

    Parameters
    ----------
    steps : (R, C, K) int8
        Evidence in [-1, 1] in units of 1 / `STEPS`; 0 for an erasure.
    placement : Placement or None
        Which words carriers may hold.
    """

    steps: NDArray[Any]
    placement: Placement | None = None


@dataclass(frozen=True, eq=False)
class Strand:
    """Evidence of one mesh over its frames, under one hypothesis of what was done to it.

    Parameters
    ----------
    restored : int
        Iterations of smoothing that were undone first.
    log_belief : float
        Log belief in this hypothesis, beside those of the other strands.
    log_prior : (R,) float64
        Log belief in each reading; the exponentials sum to at most 1.
    frames : sequence of T FrameEvidence
        At least one; all of the same shape. Of long animations they need not be in memory: they
        are asked for one at a time.
    """

    restored: int
    log_belief: float
    log_prior: FloatArray
    frames: Sequence[FrameEvidence]

    @classmethod
    def of(
        cls,
        soft: NDArray[np.floating[Any]],
        log_prior: FloatArray,
        restored: int = 0,
        log_belief: float = 0.0,
        placements: Sequence[Placement] | None = None,
    ) -> Strand:
        """Make a strand of evidence (T, R, C, K) in [-1, 1]."""
        steps = in_steps(soft)
        placed = zip(steps, placements or (None,) * len(steps), strict=True)
        frames = tuple(FrameEvidence(*frame) for frame in placed)
        return cls(restored, log_belief, log_prior, frames)

    @cached_property
    def shape(self) -> tuple[int, int, int, int]:
        """Numbers of frames, readings, carriers and chips: T, R, C and K."""
        R, C, K = self.frames[0].steps.shape
        return len(self.frames), R, C, K

    def reading(self, index: int) -> NDArray[np.int8]:
        """Evidence of all frames as one reading gives it, (T, C, K), in units of 1 / `STEPS`."""
        return np.array([frame.steps[index] for frame in self.frames])

    @cached_property
    def pooled(self) -> FloatArray:
        """Evidence of all frames together, (R, C, K): the mean of the frames' evidence.

        A sum of signed numbers measured without the key is again one, so that the frames need
        not be independent of each other for the p-value to hold.
        """
        total = np.zeros(self.shape[1:], dtype=np.int64)
        for frame in self.frames:
            total += frame.steps
        return total / (STEPS * len(self.frames))

    @property
    def placements(self) -> Sequence[Placement] | None:
        """Which words carriers may hold, as each frame tells."""
        if self.frames[0].placement is None:
            return None
        return Made(self._placement_of, len(self.frames))

    def _placement_of(self, index: int) -> Placement:
        placement = self.frames[index].placement
        assert placement is not None
        return placement

    @cached_property
    def placement(self) -> Placement | None:
        """Which words carriers may hold, as the frames that show them tell together."""
        placements = self.placements
        return None if placements is None else together(placements)

    @property
    def belief(self) -> FloatArray:
        """Log belief in each reading of this strand, (R,)."""
        return self.log_prior + self.log_belief

    def select(self, indices: Sequence[int]) -> Strand:
        """Keep some frames."""
        return replace(self, frames=tuple(self.frames[t] for t in indices))


def in_steps(soft: NDArray[np.floating[Any]]) -> NDArray[np.int8]:
    """Round evidence in [-1, 1] to whole units of 1 / `STEPS`, one byte a number.

    What says little still says something: only an erasure becomes 0.
    """
    exact = STEPS * soft.astype(np.float64)
    steps = np.rint(exact)
    steps = np.where((exact != 0.0) & (steps == 0.0), np.sign(exact), steps)
    return np.asarray(steps, dtype=np.int8)
