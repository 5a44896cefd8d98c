"""The closed loop: measure, set targets, move, and measure again what really came of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.extension.carrier import Chips, measure
from meshmark.extension.interfaces import BinnedScheme
from meshmark.mesh.animation import Frame
from meshmark.mesh.flip_guard import restrain
from meshmark.mesh.smoothing import smooth, umbrella
from meshmark.mesh.topology import Topology, boundary_edges, edges
from meshmark.statistics.p_values import log10_p_words

ROUNDS = 6
# Aim past the target: rounding to float32 and neighbours that move too eat a little.
OVERSHOOT = 1.15
# A chip that keeps more than this share of its shortfall through a round is given up.
STALLED = 0.97
# Share of its strength that a chip must keep through the rehearsed smoothing.
REHEARSED = 0.6
LAYOUT_ROUNDS = 3
# Share of its evidence that blind detection must find for a layout to count as settled.
SETTLED = 0.9


@dataclass(frozen=True, eq=False)
class ClosedLoopPlan:
    """All that is needed to mark one frame; picklable, for worker processes.

    Parameters
    ----------
    scheme : BinnedScheme
        Where carriers come from and how vertices move.
    topology : Topology
        Of all frames, as analysis sees them.
    layout : object
        What the scheme found in the first frame.
    words : (C, K) int
        Target sign of every chip.
    generator : numpy.random.Generator
        Seeded by the key. Every frame starts from this very state, so that what is chosen at
        random is chosen alike over time.
    reference : Frame, optional
        The first frame and, in `marked`, what became of it: for schemes that carry moves.
    """

    scheme: BinnedScheme
    topology: Topology
    layout: Any
    words: IntArray
    generator: np.random.Generator
    reference: tuple[Frame, Frame] | None = None

    @property
    def carriers(self) -> int:
        """Number of carriers."""
        return len(self.words)

    def mark(self, index: int, frame: Frame) -> FloatArray:
        """Return the marked positions (N, 3) of a frame; `index` makes no difference."""
        if self.scheme.propagate == "delta" and self.reference is not None:
            reference, marked = self.reference
            if np.array_equal(frame.points, reference.points):
                return marked.points
            points = self.scheme.carry(frame, self.layout, reference, marked, self.words)
            return restrain(frame.points, points, frame.faces)
        return drive(frame, self)

    @cached_property
    def umbrella(self) -> csr_matrix:
        """Smoothing operator of the mesh, (N, N) sparse."""
        F = self.topology.triangles
        return umbrella(edges(F), boundary_edges(F).reshape(-1), self.topology.n_points)


def settle(
    first: Frame, scheme: BinnedScheme, words: IntArray, generator: np.random.Generator, step: float
) -> ClosedLoopPlan:
    """Find a layout of the first frame that its own marked version leads back to.

    Detection has the marked frame only. Where its layout differs from the one that was marked
    (a part's cut may shift by an edge), the mark is laid over that one instead, and so on;
    the layout under which blind detection does best is kept.

    Parameters
    ----------
    first : Frame
        As analysis sees it.
    step : float
        What coordinates are rounded to where they are stored.
    """
    layout = scheme.layout(first)
    best: tuple[float, ClosedLoopPlan] | None = None
    for _ in range(LAYOUT_ROUNDS):
        n_carriers = len(scheme.carriers(first, layout))
        targets = words[np.arange(n_carriers) % len(words)]
        plan = ClosedLoopPlan(scheme, first.topology, layout, targets, generator)
        moves = drive(first, plan) - first.points
        # What is stored is whole steps from where it was, wherever a transform takes it.
        marked = first.moved(first.points + np.rint(moves / step) * step)
        known = _score(marked, scheme, layout, words)
        layout = scheme.layout(marked)
        blind = _score(marked, scheme, layout, words)
        if best is None or blind < best[0]:
            best = (blind, replace(plan, reference=(first, marked)))
        if blind <= SETTLED * known:
            break
    assert best is not None
    return best[1]


def _score(marked: Frame, scheme: BinnedScheme, layout: Any, words: IntArray) -> float:
    """Log10 p of the first frame under a layout: the more negative, the better."""
    chips = measure(scheme.carriers(marked, layout))
    return float(log10_p_words(np.clip(chips.value / scheme.strength, -1.0, 1.0), words))


def drive(frame: Frame, plan: ClosedLoopPlan) -> FloatArray:
    """Bring every chip of a frame to its target, as far as it will go.

    Returns
    -------
    (N, 3) float64
        The positions under which the chips, measured anew, fell short of their targets least.
    """
    # A copy: every frame must draw the same numbers.
    rng = np.random.Generator(np.random.PCG64())
    rng.bit_generator.state = plan.generator.bit_generator.state
    points = frame.points
    best: tuple[float, FloatArray] = (np.inf, points)
    before = np.full(plan.words.shape, np.inf)
    for _ in range(ROUNDS):
        current = frame.moved(points)
        carriers = plan.scheme.carriers(current, plan.layout)
        lacking = _lacking(current, measure(carriers), plan)
        total = float(lacking.sum())
        if total < best[0]:
            best = (total, points)
        # A chip that hardly comes nearer has no room left; pushing on would only distort.
        wanted = np.where(lacking < STALLED * before, lacking, 0.0)
        if not wanted.any():
            break
        before = np.where(lacking > 0.0, wanted, np.inf)
        shifts = plan.words * wanted * OVERSHOOT
        points = plan.scheme.move(current, plan.layout, carriers, list(shifts), rng)
        points = restrain(frame.points, points, frame.faces)
    return best[1]


def _lacking(current: Frame, chips: Chips, plan: ClosedLoopPlan) -> FloatArray:
    """How far each chip is from its target, as it stands and as it comes out of rehearsal."""
    lacking = _shortfall(chips, plan.words, plan.scheme.strength)
    if plan.scheme.rehearsal == 0:
        return lacking
    smoothed = smooth(current.points, plan.umbrella, plan.scheme.rehearsal)
    after = measure(plan.scheme.carriers(current.moved(smoothed), plan.layout))
    return np.maximum(lacking, _shortfall(after, plan.words, REHEARSED * plan.scheme.strength))


def _shortfall(chips: Chips, words: IntArray, strength: float) -> FloatArray:
    """How far each chip is from its target, in bins; 0 for one that is there, or erased."""
    return np.where(chips.held, np.maximum(0.0, strength - words * chips.value), 0.0)
