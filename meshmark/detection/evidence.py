"""Evidence: what a file says, before any key is tried on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.detection.vertex_evidence import VertexEvidence
from meshmark.keys import Key
from meshmark.statistics.p_values import reachable_log10_p
from meshmark.statistics.word_windows import WordPosterior, median_posterior

Thing = TypeVar("Thing")

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
    posterior : WordPosterior or None
        Which words carriers may hold.
    """

    steps: NDArray[Any]
    posterior: WordPosterior | None = None


@dataclass(frozen=True, eq=False)
class RestoredVariant:
    """Evidence of one mesh over its frames, under one hypothesis of what was done to it.

    Parameters
    ----------
    restored : int
        Iterations of smoothing that were undone first.
    log_belief : float
        Log belief in this hypothesis, beside those of the other variants.
    log_prior : (R,) float64
        Log belief in each hypothesis; the exponentials sum to at most 1.
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
        posteriors: Sequence[WordPosterior] | None = None,
    ) -> RestoredVariant:
        """Make a variant of evidence (T, R, C, K) in [-1, 1]."""
        steps = in_steps(soft)
        placed = zip(steps, posteriors or (None,) * len(steps), strict=True)
        frames = tuple(FrameEvidence(*frame) for frame in placed)
        return cls(restored, log_belief, log_prior, frames)

    @cached_property
    def shape(self) -> tuple[int, int, int, int]:
        """Numbers of frames, hypotheses, carriers and chips: T, R, C and K."""
        R, C, K = self.frames[0].steps.shape
        return len(self.frames), R, C, K

    def under(self, index: int) -> NDArray[np.int8]:
        """Evidence of all frames under one hypothesis, (T, C, K), in units of 1 / `STEPS`."""
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
    def posteriors(self) -> Sequence[WordPosterior] | None:
        """Which words carriers may hold, as each frame tells."""
        if self.frames[0].posterior is None:
            return None
        return LazySequence(self._placement_of, len(self.frames))

    def _placement_of(self, index: int) -> WordPosterior:
        posterior = self.frames[index].posterior
        assert posterior is not None
        return posterior

    @cached_property
    def posterior(self) -> WordPosterior | None:
        """Which words carriers may hold, as the frames that show them tell together."""
        posteriors = self.posteriors
        return None if posteriors is None else median_posterior(posteriors)

    @property
    def belief(self) -> FloatArray:
        """Log belief in each hypothesis of this variant, (R,)."""
        return self.log_prior + self.log_belief

    def select(self, indices: Sequence[int]) -> RestoredVariant:
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


@dataclass(frozen=True)
class InformedFacts:
    """How a copy was laid upon its original before it was measured.

    Parameters
    ----------
    prim : str
        The mesh of the original.
    poses : tuple of float
        Frame of the original that each frame of the copy shows, between two where it is a blend.
    maps : tuple of str
        Maps of space that were tried: "similarity", "affine", "cubic".
    method : str
        How the placement was found: "identity", "reposed", "pca" or "features".
    residual : float
        Distance of the copy from the original, a share of the diagonal.
    covered : float
        Share of the original's surface that the copy covers.
    patches : int
        Chips that say something.
    """

    prim: str
    poses: tuple[float, ...]
    maps: tuple[str, ...]
    method: str
    residual: float
    covered: float
    patches: int


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
    variants : tuple of RestoredVariant
        The mesh as it stands first; beside it, the mesh as it may have been.
    tracked : bool
        Whether a carrier is the same in all frames because its vertices are. If not, carriers
        of different frames were matched by what they look like, which can go wrong.
    bit_threshold : float
        Evidence that a chip must exceed to count as a bit in bit error rates.
    part : str
        Which part of the mesh was measured; empty for all of it.
    also : tuple of str
        Further meshes that have parts in it.
    informed : InformedFacts or None
        How it was laid upon the original, where it was measured beside that.
    vertices : VertexEvidence or None
        What single vertices tell, where the scheme reads them.
    """

    prim: str
    scheme: str
    n_words: int
    times: FloatArray
    variants: tuple[RestoredVariant, ...]
    tracked: bool = True
    bit_threshold: float = 0.0
    part: str = ""
    also: tuple[str, ...] = ()
    informed: InformedFacts | None = None
    vertices: VertexEvidence | None = None

    @cached_property
    def held(self) -> BoolArray:
        """Chips of the mesh as it stands that are held in some frame, (C, K) bool."""
        return np.asarray(self.variants[0].under(0).any(axis=0))

    @property
    def n_chips(self) -> int:
        """Chips of one carrier, K."""
        return int(self.variants[0].shape[3])

    @property
    def carriers(self) -> int:
        """Number of carriers, C, of the mesh as it stands."""
        return int(self.variants[0].shape[2])

    @property
    def chips(self) -> int:
        """Number of chips that are held in some frame, shared ones counted once."""
        held = self.held
        return int(held.any(axis=0).sum() if self.n_words == 1 else held.sum())

    @cached_property
    def reachable_log10_p(self) -> float:
        """Lowest log10 p that the best of keys could reach on as many chips."""
        if not self.held.any():
            return 0.0
        plain = self.variants[0]
        best = int(np.argmax(plain.belief))
        posterior = plain.posterior and plain.posterior.under(best)
        return reachable_log10_p(self.held, self.n_words, float(plain.belief[best]), posterior)

    def words(self, key: Key, recipient: str | None) -> IntArray:
        """Derive the code words that `key` would have used here, (M, K) int."""
        return key.words(self.scheme, self.n_words, self.n_chips, recipient)

    def select(self, frames: Sequence[int]) -> Evidence:
        """Keep some frames."""
        variants = tuple(variant.select(frames) for variant in self.variants)
        return replace(self, times=self.times[list(frames)], variants=variants)


class LazySequence(Sequence[Thing]):
    """A sequence whose items are made whenever they are asked for; pickles as a tuple of them.

    Parameters
    ----------
    make : callable
        Makes the item of an index, from 0 to `length` - 1.
    length : int
        Number of items.
    """

    def __init__(self, make: Callable[[int], Thing], length: int) -> None:
        self._make, self._indices = make, range(length)

    def __len__(self) -> int:
        return len(self._indices)

    @overload
    def __getitem__(self, index: int) -> Thing: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Thing]: ...

    def __getitem__(self, index: int | slice) -> Thing | Sequence[Thing]:
        if isinstance(index, slice):
            chosen = self._indices[index]
            return LazySequence(lambda i: self._make(chosen[i]), len(chosen))
        return self._make(self._indices[index])

    def __iter__(self) -> Iterator[Thing]:
        return map(self._make, self._indices)

    def __reduce__(self) -> tuple[Any, ...]:
        return (tuple, (tuple(self),))
