"""The closed loop: measure, set targets, move, and measure again what really came of it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import CapacityError, InputError, MeshmarkError
from meshmark.extension.breakdown import breakdown_means_no_capacity
from meshmark.extension.carrier import Chips, measure
from meshmark.extension.interfaces import AnyScheme, JointScheme, MarkingPlan, Scheme
from meshmark.keys import Key
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.flip_guard import restrain
from meshmark.mesh.geometry import surface_box
from meshmark.mesh.precision import require_precision, rounding_of
from meshmark.mesh.smoothing import smooth, umbrella
from meshmark.mesh.topology import boundary_edges, edges
from meshmark.mesh.welding import Welding
from meshmark.statistics.p_values import log10_p_words
from meshmark.workers.ordered_map import ordered_map, sharing_workers
from meshmark.workers.progress import FrameProgress
from meshmark.workers.scratch import DisplacedFrames, ScratchFile

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
class Plan:
    """All that is needed to mark one frame; picklable, for worker processes.

    Parameters
    ----------
    scheme : Scheme
        Where carriers come from and how vertices move.
    welding : Welding
        The mesh as analysis sees it.
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

    scheme: Scheme
    welding: Welding
    layout: Any
    words: IntArray
    generator: np.random.Generator
    reference: tuple[Frame, Frame] | None = None

    @cached_property
    def umbrella(self) -> csr_matrix:
        """Smoothing operator of the analysed mesh, (M, M) sparse."""
        topology = self.welding.topology
        F = topology.triangles
        return umbrella(edges(F), boundary_edges(F).reshape(-1), topology.n_points)


@dataclass(frozen=True, eq=False)
class Embedded:
    """A marked mesh, and what was written into it.

    Parameters
    ----------
    animation : MeshAnimation
        All frames, those outside `frames` untouched.
    frames : tuple of int
        Indices of the marked frames.
    carriers : int
        Number of carriers.
    """

    animation: MeshAnimation
    frames: tuple[int, ...]
    carriers: int


@sharing_workers
def embed_animation(
    animation: MeshAnimation,
    scheme: AnyScheme,
    scheme_name: str,
    key: Key,
    *,
    recipient: str | None = None,
    frames: tuple[int, ...] | None = None,
    jobs: int = 1,
    progress: FrameProgress | None = None,
) -> Embedded:
    """Mark one mesh.

    Parameters
    ----------
    frames : tuple of int, optional
        Indices of the frames to mark; all by default.
    jobs : int
        Worker processes.
    progress : callable, optional
        Called with (frames done, frames in all).

    Raises
    ------
    InputError
        If the connectivity changes over time.
    CapacityError
        If the mesh cannot hold a mark.
    OutputError
        If there is no room for temporary files.
    """
    if not animation.constant_topology:
        raise InputError(
            "the connectivity changes over time; a mark needs vertices that keep their identity",
            source=animation.origin,
            prim=animation.prim,
        )
    chosen = tuple(range(len(animation))) if frames is None else frames
    first = animation[chosen[0]]
    words = key.words(scheme_name, scheme.n_words, scheme.n_chips, recipient)
    scratch = ScratchFile.create(len(animation), first.topology.n_points)
    try:
        doubts = require_precision(animation, first)
        work: MarkFrame | MarkPlanned
        with breakdown_means_no_capacity():
            if isinstance(scheme, JointScheme):
                work = plan_jointly(animation.select(chosen), scheme, words, jobs)
            else:
                generator = key.generator(f"embed/{scheme_name}")
                rounding = rounding_of(animation, first)
                plan = settle(first, scheme, words, generator, rounding)
                work = MarkFrame(animation.select(chosen), plan)
    except CapacityError as error:
        raise CapacityError(error.message, source=animation.origin, prim=animation.prim) from None
    displacements = ordered_map(work, range(len(chosen)), jobs=jobs)
    for done, (index, displacement) in enumerate(zip(chosen, displacements, strict=True), start=1):
        scratch.write(index, displacement)
        if progress is not None:
            progress(done, len(chosen))
    marked = replace(
        animation,
        source=DisplacedFrames(animation.source, scratch),
        notes=(*animation.notes, *doubts),
    )
    return Embedded(marked, chosen, work.carriers)


def plan_jointly(
    animation: MeshAnimation, scheme: JointScheme, words: IntArray, jobs: int
) -> MarkPlanned:
    """Let a joint scheme plan all frames of an animation, as analysis sees them."""
    welding = Welding.of(animation[0])
    plan = scheme.plan(animation.map(welding.frame), words, jobs=jobs)
    return MarkPlanned(animation, welding, plan)


@dataclass(frozen=True, eq=False)
class MarkPlanned:
    """Marks frame after frame of an animation by a joint scheme's plan."""

    animation: MeshAnimation
    welding: Welding
    plan: MarkingPlan

    @property
    def carriers(self) -> int:
        """Number of carriers."""
        return self.plan.carriers

    def __call__(self, index: int) -> FloatArray:
        """Return the displacement (N, 3) of every point of frame `index`."""
        with _naming(self.animation, index):
            analysed = self.welding.frame(self.animation[index])
            return self.welding.spread(self.plan.mark(index, analysed) - analysed.points)


@contextmanager
def _naming(animation: MeshAnimation, index: int) -> Iterator[None]:
    """Name file, prim and frame in whatever goes wrong with a frame."""
    try:
        with breakdown_means_no_capacity():
            yield
    except MeshmarkError as error:
        raise type(error)(
            error.message,
            source=animation.origin,
            prim=animation.prim,
            time=float(animation.times[index]),
        ) from None


@dataclass(frozen=True, eq=False)
class MarkFrame:
    """Marks frame after frame of an animation by one plan."""

    animation: MeshAnimation
    plan: Plan

    @property
    def carriers(self) -> int:
        """Number of carriers."""
        return len(self.plan.words)

    def __call__(self, index: int) -> FloatArray:
        """Return the displacement (N, 3) of every point of frame `index`."""
        with _naming(self.animation, index):
            analysed = self.plan.welding.frame(self.animation[index])
            return self.plan.welding.spread(mark(analysed, self.plan) - analysed.points)


def settle(
    first: Frame, scheme: Scheme, words: IntArray, generator: np.random.Generator, rounding: float
) -> Plan:
    """Find a layout of the first frame that its own marked version leads back to.

    Detection has the marked frame only. Where its layout differs from the one that was marked
    (a part's cut may shift by an edge), the mark is laid over that one instead, and so on;
    the layout under which blind detection does best is kept.

    Parameters
    ----------
    rounding : float
        What positions will be rounded to, as a share of the diagonal; see
        `meshmark.mesh.precision`.
    """
    welding = Welding.of(first)
    analysed = welding.frame(first)
    step = rounding * surface_box(first.points, first.faces)[0]
    layout = scheme.layout(analysed)
    best: tuple[float, Plan] | None = None
    for _ in range(LAYOUT_ROUNDS):
        n_carriers = len(scheme.carriers(analysed, layout))
        targets = words[np.arange(n_carriers) % len(words)]
        plan = Plan(scheme, welding, layout, targets, generator)
        moves = drive(analysed, plan) - analysed.points
        # What is stored is whole steps from where it was, wherever a transform takes it.
        marked = analysed.moved(analysed.points + np.rint(moves / step) * step)
        known = _score(marked, scheme, layout, words)
        layout = scheme.layout(marked)
        blind = _score(marked, scheme, layout, words)
        if best is None or blind < best[0]:
            best = (blind, replace(plan, reference=(analysed, marked)))
        if blind <= SETTLED * known:
            break
    assert best is not None
    return best[1]


def _score(marked: Frame, scheme: Scheme, layout: Any, words: IntArray) -> float:
    """Log10 p of the first frame under a layout: the more negative, the better."""
    chips = measure(scheme.carriers(marked, layout))
    return float(log10_p_words(np.clip(chips.value / scheme.strength, -1.0, 1.0), words))


def mark(frame: Frame, plan: Plan) -> FloatArray:
    """Return the marked positions (N, 3) of one analysed frame."""
    if plan.scheme.propagate == "delta" and plan.reference is not None:
        reference, marked = plan.reference
        if np.array_equal(frame.points, reference.points):
            return marked.points
        points = plan.scheme.carry(frame, plan.layout, reference, marked, plan.words)
        return restrain(frame.points, points, frame.faces)
    return drive(frame, plan)


def drive(frame: Frame, plan: Plan) -> FloatArray:
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


def _lacking(current: Frame, chips: Chips, plan: Plan) -> FloatArray:
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
