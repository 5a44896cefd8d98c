"""The scheme itself: parts of the first frame, distances in every frame, moves along edges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from meshmark.arrays import BoolArray, FloatArray, IntArray
from meshmark.errors import CapacityError, UsageError
from meshmark.extension.carrier import Carrier
from meshmark.extension.interfaces import GeodesicSolver, Segmenter
from meshmark.mesh.animation import Frame
from meshmark_plugins.schemes.tsai2014.moves import extreme_neighbours, share_out, steepness
from meshmark_plugins.schemes.tsai2014.parts import Part, labelled_parts

PROPAGATIONS = ("adapt", "delta")
# Fewer vertices than this many a set, on average, and the sets' means are mostly chance.
MIN_VERTICES_PER_SET = 4
# How near to its bin's end a move may take a vertex, in bins: past it, the vertex would leave
# the set it was to push, and join the next.
BIN_MARGIN = 0.02
# A set whose lowest vertex lies above this fraction of the set is an erasure.
TRUNCATED_FRACTION = 0.2
# By how much a move that leaves the surface at a right angle is put off, in lengths of the random
# order; measured on a horse: 4 lowers MRMS by a tenth, 20 by little more.
STEEPNESS_DELAY = 4.0


@dataclass(frozen=True, eq=False)
class PartDistances(Carrier):
    """A part in one frame: a carrier that remembers its distances.

    Parameters
    ----------
    distance : (n,) float64
        Mean geodesic distance of each vertex to the cut, in bins.
    """

    distance: FloatArray


class Tsai2014:
    """Bits in the mean geodesic distance of each part's vertices to its cut.

    Parameters
    ----------
    segmenter : Segmenter
        Cuts the first frame into parts.
    solver : callable
        (V, F) -> GeodesicSolver, built on each part's own sub-mesh.
    bits : int
        N_w, sets (and bits) of each part; 2 to 256.
    strength : float
        Delta, in bins: how far from its centre a set's mean is pushed; in (0, 0.5).
    words : int
        1: all parts carry one and the same code word, as published; 16 bits can then never
        prove more than 2^-16. From 2 to 12: as many words, given to the parts in order of
        size, so that the parts' evidence adds up.
    propagate : str
        "adapt": every frame is brought to its targets on its own distances. "delta": as
        published, the change of each vertex's distance in the first frame is applied in the
        others along each frame's own edges.
    step : float
        Longest move in one round, as a share of the edge; in (0, 0.5].
    picks : int
        In how many picks a vertex makes that move; from 1 to 100. With 1, few vertices of a set
        move far; with more, many move a little, which smoothing and simplification undo less.
    rehearsal : int
        Iterations of umbrella smoothing that the bits are to survive; from 0 to 100. The closed
        loop smooths the marked mesh, and pushes further where a bit would be lost.

    Notes
    -----
    The set of a vertex is i = ceil(d N_w / d_max), and the centre of set i is
    (i - 1/2) d_max / N_w; the published formulas (3) and (4) print i + 1/2, which is off by
    one set. A set without vertices is an erasure. Distances to a loop's vertices are averaged,
    so that none is 0 and the sets nearest to the cut are often empty.
    """

    def __init__(
        self,
        *,
        segmenter: Segmenter,
        solver: Callable[[FloatArray, IntArray], GeodesicSolver],
        bits: int = 16,
        strength: float = 0.05,
        words: int = 8,
        propagate: str = "adapt",
        rehearsal: int = 10,
        picks: int = 10,
        step: float = 0.3,
    ) -> None:
        _require_within("bits", bits, 2, 256)
        _require_within("words", words, 1, 12)
        _require_within("strength", strength, 1e-3, 0.49)
        _require_within("step", step, 1e-3, 0.5)
        _require_within("picks", picks, 1, 100)
        _require_within("rehearsal", rehearsal, 0, 100)
        if propagate not in PROPAGATIONS:
            raise UsageError(
                f"propagate must be one of {', '.join(PROPAGATIONS)}, not {propagate!r}"
            )
        self.segmenter = segmenter
        self.solver = solver
        self.n_chips = bits
        self.n_words = words
        self.strength = strength
        self.propagate = propagate
        self.rehearsal = rehearsal
        self.picks = picks
        self.step = step
        self._distance_cache: WeakKeyDictionary[Part, tuple[FloatArray, FloatArray]] = (
            WeakKeyDictionary()
        )

    def __getstate__(self) -> dict[str, Any]:
        # The cache stays in the process that filled it.
        return {name: value for name, value in vars(self).items() if name != "_distance_cache"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, _distance_cache=WeakKeyDictionary())

    def layout(self, frame: Frame) -> tuple[Part, ...]:
        """Segment a frame and return the parts that can carry a mark."""
        labels = self.segmenter.segment(frame.points, frame.faces)
        parts = labelled_parts(frame.faces, labels, MIN_VERTICES_PER_SET * self.n_chips)
        if not parts:
            count = len(np.unique(labels))
            raise CapacityError(
                f"no part can hold {self.n_chips} bits: {len(frame.points)} points in {count} "
                f"part{'s' if count != 1 else ''}; a part needs a cut to another one and at "
                f"least {MIN_VERTICES_PER_SET * self.n_chips} points"
            )
        return parts

    def carriers(self, frame: Frame, layout: tuple[Part, ...]) -> list[PartDistances]:
        """Measure the mean distance to the cut in every part."""
        root_area = float(np.sqrt(_area(frame.points, frame.faces)))
        return [self._carrier(frame, part, root_area) for part in layout]

    def _carrier(self, frame: Frame, part: Part, root_area: float) -> PartDistances:
        V = frame.points[part.vertices]
        d = self._mean_distance(part, V)
        usable = part.inside & np.isfinite(d)
        d_max = float(d[usable].max(initial=0.0))
        bins = np.full(len(d), -1)
        x = np.zeros(len(d))
        if d_max > 0.0:
            x = np.where(np.isfinite(d), d, 0.0) * (self.n_chips / d_max)
            bins = np.where(usable, np.clip(np.ceil(x), 1, self.n_chips).astype(np.int64) - 1, -1)
            bins[bins == _truncated_set(x[usable])] = -1
        area = _area(V, part.faces)
        return PartDistances(
            vertices=part.vertices,
            bins=bins,
            bin_fraction=x - bins,
            n_bins=self.n_chips,
            descriptor=np.array([np.sqrt(area), d_max, float(d[part.loop].mean())]) / root_area,
            distance=x,
        )

    def _mean_distance(self, part: Part, V: FloatArray) -> FloatArray:
        """Mean distance of a part's vertices to its loop, (n,); the last result is cached.

        The closed loop asks again after every round, when most parts have long stopped moving.
        """
        cached = self._distance_cache.get(part)
        if cached is not None and np.array_equal(V, cached[0]):
            return cached[1]
        d: FloatArray = self.solver(V, part.faces).distances(part.loop).mean(axis=0)
        self._distance_cache[part] = (V, d)
        return d

    def move(
        self,
        frame: Frame,
        layout: tuple[Part, ...],
        carriers: Sequence[Carrier],
        shifts: Sequence[FloatArray],
        rng: np.random.Generator,
    ) -> FloatArray:
        """Move randomly chosen vertices along edges until each set's mean is where it should."""
        rank = rng.permutation(len(frame.points))
        points = frame.points.copy()
        for part, carrier, shift in zip(layout, carriers, shifts, strict=True):
            assert isinstance(carrier, PartDistances)
            if np.any(shift):
                points[part.vertices] += self._moves(points, part, carrier, shift, rank)
        return points

    def _moves(
        self,
        points: FloatArray,
        part: Part,
        carrier: PartDistances,
        shift: FloatArray,
        rank: IntArray,
    ) -> FloatArray:
        bins = np.where(_movable(part, carrier), carrier.bins, -1)
        wanted = np.where(bins >= 0, shift[bins], 0.0)
        slopes = extreme_neighbours(carrier.distance, part.edges, wanted > 0)
        room = np.where(wanted > 0, 1.0 - carrier.bin_fraction, carrier.bin_fraction) - BIN_MARGIN
        available = np.minimum(self.step * slopes.gain, np.maximum(room, 0.0))
        available[wanted == 0.0] = 0.0
        count = np.bincount(carrier.bins[carrier.bins >= 0], minlength=self.n_chips)
        V = points[part.vertices]
        # At random, but flat places before curved ones, where leaving the surface shows.
        turn = rank[part.vertices] / len(rank)
        turn += STEEPNESS_DELAY * steepness(V, part.faces, slopes.neighbour)
        taken = share_out(np.abs(shift) * count, bins, available, turn, self.picks)
        return _moves_along(V, slopes.neighbour, taken, slopes.gain)

    def carry(
        self,
        frame: Frame,
        layout: tuple[Part, ...],
        reference: Frame,
        marked: Frame,
        words: IntArray,
    ) -> FloatArray:
        """Give each vertex the change of distance it had in the first frame, along own edges."""
        before, after = self.carriers(reference, layout), self.carriers(marked, layout)
        points = frame.points.copy()
        own = self.carriers(frame, layout)
        for part, old, new, here, word in zip(layout, before, after, own, words, strict=True):
            still = np.all(reference.points[part.vertices] == marked.points[part.vertices], axis=1)
            bins = np.where(still | part.fixed, -1, old.bins)
            delta = np.where(bins >= 0, np.abs(new.distance - old.distance), 0.0)
            slopes = extreme_neighbours(here.distance, part.edges, word[bins] > 0)
            taken = np.minimum(delta, self.step * slopes.gain)
            points[part.vertices] += _moves_along(
                points[part.vertices], slopes.neighbour, taken, slopes.gain
            )
        return points


def _truncated_set(x: FloatArray) -> int:
    """Find the set that the smallest distance lies well inside of, -1 if there is none.

    A mean over a loop is never 0: the set in which distances begin is filled from its upper
    end only. Its mean lies high whatever bit it is to hold, and so it can hold none.
    """
    lowest = float(x.min())
    first = int(np.ceil(lowest)) - 1
    return first if lowest - first > TRUNCATED_FRACTION else -1


def _movable(part: Part, carrier: PartDistances) -> BoolArray:
    """Select all vertices but those on a cut, the one that makes d_max, and its one-ring."""
    movable = ~part.fixed
    farthest = int(np.argmax(np.where(carrier.bins >= 0, carrier.distance, -np.inf)))
    ring = part.edges[np.any(part.edges == farthest, axis=1)]
    movable[ring.reshape(-1)] = False
    return movable


def _moves_along(
    V: FloatArray, neighbour: IntArray, taken: FloatArray, gain: FloatArray
) -> FloatArray:
    share = np.divide(taken, gain, out=np.zeros_like(taken), where=gain > 0.0)
    return share[:, None] * (V[neighbour] - V)


def _area(V: FloatArray, F: IntArray) -> float:
    a, b, c = V[F[:, 0]], V[F[:, 1]], V[F[:, 2]]
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def _require_within(name: str, value: Any, low: float, high: float) -> None:
    if not isinstance(value, int | float) or not low <= value <= high:
        raise UsageError(f"{name} must be between {low:g} and {high:g}, not {value!r}")
