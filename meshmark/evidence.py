"""Evidence: what a file says, before any key is tried on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meshmark.keys import Key
from meshmark.placement import Placement, together
from meshmark.statistics import reachable_log10_p

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# Evidence is kept in steps of 1 / 127, an eighth of the room: whoever is judged by it is judged
# by the rounded numbers, which are as independent of the key as the others.
STEPS = 127


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
    steps : (T, R, C, K) int8
        Evidence in [-1, 1] in units of 1 / `STEPS`; 0 for an erasure.
    placements : tuple of T Placement, or None
        Which words carriers may hold, as each frame tells.
    """

    restored: int
    log_belief: float
    log_prior: FloatArray
    steps: NDArray[np.int8]
    placements: tuple[Placement, ...] | None = None

    @classmethod
    def of(
        cls,
        soft: NDArray[np.floating[Any]],
        log_prior: FloatArray,
        restored: int = 0,
        log_belief: float = 0.0,
        placements: tuple[Placement, ...] | None = None,
    ) -> Strand:
        """Make a strand of evidence (T, R, C, K) in [-1, 1]."""
        return cls(restored, log_belief, log_prior, in_steps(soft), placements)

    def frame(self, index: int) -> FloatArray:
        """Evidence of one frame, (R, C, K), in [-1, 1]."""
        return self.steps[index] / STEPS

    @cached_property
    def pooled(self) -> FloatArray:
        """Evidence of all frames together, (R, C, K): the mean of the frames' evidence.

        A sum of signed numbers measured without the key is again one, so that the frames need
        not be independent of each other for the p-value to hold.
        """
        return np.add.reduce(self.steps, axis=0, dtype=np.int64) / (STEPS * len(self.steps))

    @cached_property
    def placement(self) -> Placement | None:
        """Which words carriers may hold, as the frames that show them tell together."""
        return None if self.placements is None else together(self.placements)

    @property
    def belief(self) -> FloatArray:
        """Log belief in each reading of this strand, (R,)."""
        return self.log_prior + self.log_belief

    def select(self, frames: Sequence[int]) -> Strand:
        """Keep some frames."""
        chosen = list(frames)
        placements = self.placements and tuple(self.placements[t] for t in chosen)
        return replace(self, steps=self.steps[chosen], placements=placements)


def in_steps(soft: NDArray[np.floating[Any]]) -> NDArray[np.int8]:
    """Round evidence in [-1, 1] to whole units of 1 / `STEPS`, one byte a number.

    What says little still says something: only an erasure becomes 0.
    """
    exact = STEPS * soft.astype(np.float64)
    steps = np.rint(exact)
    steps = np.where((exact != 0.0) & (steps == 0.0), np.sign(exact), steps)
    return np.asarray(steps, dtype=np.int8)


@dataclass(frozen=True, eq=False)
class Evidence:
    """Chips of one mesh over its frames, measured without any key.

    Parameters
    ----------
    prim : str
        The mesh.
    scheme : str
        The scheme that measured it.
    n_words : int
        Code words of that scheme; 1 if all carriers share one.
    times : (T,) float64
        Time codes of the frames.
    strands : tuple of Strand
        The mesh as it stands first; beside it, the mesh as it may have been.
    tracked : bool
        Whether a carrier is the same in all frames because its vertices are. If not, carriers
        of different frames were matched by what they look like, which can go wrong.
    decisive : float
        Evidence that a chip must exceed to count as a bit in bit error rates.
    """

    prim: str
    scheme: str
    n_words: int
    times: FloatArray
    strands: tuple[Strand, ...]
    tracked: bool = True
    decisive: float = 0.0

    @property
    def held(self) -> BoolArray:
        """Chips of the mesh as it stands that are held in some frame, (C, K) bool."""
        plain = self.strands[0].steps[:, 0]
        return np.asarray((plain != 0).any(axis=0))

    @property
    def n_chips(self) -> int:
        """Chips of one carrier, K."""
        return int(self.strands[0].steps.shape[3])

    @property
    def carriers(self) -> int:
        """Number of carriers, C, of the mesh as it stands."""
        return int(self.strands[0].steps.shape[2])

    @property
    def chips(self) -> int:
        """Number of chips that are held in some frame, shared ones counted once."""
        held = self.held
        return int(held.any(axis=0).sum() if self.n_words == 1 else held.sum())

    @property
    def reachable_log10_p(self) -> float:
        """Lowest log10 p that the best of keys could reach on as many chips."""
        plain = self.strands[0]
        best = int(np.argmax(plain.belief))
        placement = plain.placement and plain.placement.under(best)
        return reachable_log10_p(self.held, self.n_words, float(plain.belief[best]), placement)

    def words(self, key: Key, recipient: str | None) -> IntArray:
        """Derive the code words that `key` would have used here, (M, K) int."""
        return key.words(self.scheme, self.n_words, self.n_chips, recipient)

    def select(self, frames: Sequence[int]) -> Evidence:
        """Keep some frames."""
        strands = tuple(strand.select(frames) for strand in self.strands)
        return replace(self, times=self.times[list(frames)], strands=strands)
