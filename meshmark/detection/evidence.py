"""Evidence: what a file says, before any key is tried on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar, overload

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.detection.strand import Strand
from meshmark.keys import Key
from meshmark.statistics.p_values import reachable_log10_p

Thing = TypeVar("Thing")


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
    part : str
        Which part of the mesh was measured; empty for all of it.
    also : tuple of str
        Further meshes that have parts in it.
    """

    prim: str
    scheme: str
    n_words: int
    times: FloatArray
    strands: tuple[Strand, ...]
    tracked: bool = True
    decisive: float = 0.0
    part: str = ""
    also: tuple[str, ...] = ()

    @cached_property
    def held(self) -> BoolArray:
        """Chips of the mesh as it stands that are held in some frame, (C, K) bool."""
        return np.asarray(self.strands[0].reading(0).any(axis=0))

    @property
    def n_chips(self) -> int:
        """Chips of one carrier, K."""
        return int(self.strands[0].shape[3])

    @property
    def carriers(self) -> int:
        """Number of carriers, C, of the mesh as it stands."""
        return int(self.strands[0].shape[2])

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


class Made(Sequence[Thing]):
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
            return Made(lambda i: self._make(chosen[i]), len(chosen))
        return self._make(self._indices[index])

    def __iter__(self) -> Iterator[Thing]:
        return map(self._make, self._indices)

    def __reduce__(self) -> tuple[Any, ...]:
        return (tuple, (tuple(self),))
