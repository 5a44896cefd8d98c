"""Carriers and chips: what a scheme measures on a frame, reduced to numbers that need no key."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    # It needs scipy.optimize, which takes a process that only reads half of its start.
    from meshmark.statistics.word_windows import WordPosterior


@dataclass(frozen=True, eq=False)
class Carrier:
    """Some vertices of a frame, sorted into the bins of a scalar coordinate; a bin holds a chip.

    Parameters
    ----------
    vertices : (n,) int
        Indices of the vertices into the frame's points.
    bins : (n,) int
        Bin of each vertex, 0 to `n_bins` - 1; -1 for a vertex in none.
    bin_fraction : (n,) float64
        Place of each vertex within its bin, from 0 at its lower to 1 at its upper end.
    n_bins : int
        Number of bins.
    descriptor : (m,) float64
        Shape of the carrier in numbers that compare between frames, by which it is found
        again when the connectivity changes from frame to frame.
    """

    vertices: IntArray
    bins: IntArray
    bin_fraction: FloatArray
    n_bins: int
    descriptor: FloatArray


@dataclass(frozen=True, eq=False)
class Chips:
    """The chips of one frame.

    Parameters
    ----------
    value : (carriers, bins) float64
        Mean place of the vertices in the bin, less one half; 0 for an empty bin.
    count : (carriers, bins) int
        Number of vertices in the bin. An empty bin is an erasure: it says nothing, neither
        +1 nor -1.
    """

    value: FloatArray
    count: IntArray

    @property
    def held(self) -> NDArray[np.bool_]:
        """Which chips are not erasures, (carriers, bins) bool."""
        return self.count > 0


@dataclass(frozen=True, eq=False)
class Observation:
    """What one frame says, under every hypothesis about how it is to be read.

    Parameters
    ----------
    soft : (R, C, K) float or int8
        Evidence of the K chips of C carriers in [-1, 1], for each of R hypotheses; 0 for an
        erasure, which says neither +1 nor -1. Measured without any key. Schemes give it as
        floats; what is kept of it are the int8 steps of `meshmark.detection.evidence.in_steps`.
    log_prior : (R,) float64
        Natural logarithm of the belief in each hypothesis; the exponentials sum to at most 1.
    descriptors : (C, m) float64
        Shapes of the carriers, by which they are told apart between frames.
    vertices : (C,) int or None
        Vertex at which each carrier stands, where it stands at one.
    posterior : WordPosterior or None
        Which words carriers may hold, where their shapes tell.
    bit_threshold : float
        Evidence that a chip must exceed to count as a bit, in [0, 1), in bit error rates; all of
        it counts in verdicts.
    """

    soft: NDArray[Any]
    log_prior: FloatArray
    descriptors: FloatArray
    vertices: IntArray | None = None
    posterior: WordPosterior | None = None
    bit_threshold: float = 0.0


def observation_of(carriers: Sequence[Carrier], strength: float) -> Observation:
    """Turn binned carriers into evidence: a chip counts in full from `strength` on."""
    soft = np.clip(measure(carriers).value / strength, -1.0, 1.0)
    descriptors = np.array([carrier.descriptor for carrier in carriers])
    return Observation(soft[None], np.zeros(1), descriptors)


def measure(carriers: Sequence[Carrier]) -> Chips:
    """Measure the chips of a frame's carriers, all of which have the same number of bins."""
    rows = [_measure_one(carrier) for carrier in carriers]
    return Chips(
        value=np.array([value for value, _ in rows]), count=np.array([count for _, count in rows])
    )


def _measure_one(carrier: Carrier) -> tuple[FloatArray, IntArray]:
    inside = carrier.bins >= 0
    k = carrier.bins[inside]
    count = np.bincount(k, minlength=carrier.n_bins)
    moment = np.bincount(k, carrier.bin_fraction[inside] - 0.5, carrier.n_bins)
    value = np.divide(moment, count, out=np.zeros(carrier.n_bins), where=count > 0)
    return value, count.astype(np.int64)
