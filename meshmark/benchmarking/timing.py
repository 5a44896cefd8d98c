"""Where the time goes: a clock with named stages, and a recipe whose plugins report to it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from meshmark.arrays import FloatArray, IntArray
from meshmark.extension.interfaces import GeodesicSolver, Segmenter
from meshmark.extension.recipe import Recipe


@dataclass
class StageClock:
    """Seconds spent in each stage, added up over all calls."""

    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time the block takes to a stage."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


@dataclass(frozen=True)
class TimedSegmenter:
    """A segmenter that reports to a clock."""

    segmenter: Segmenter
    clock: StageClock

    def segment(self, V: FloatArray, F: IntArray) -> IntArray:
        """Label each face with its part, (F,) int."""
        with self.clock.stage("segment"):
            return self.segmenter.segment(V, F)


@dataclass(frozen=True)
class TimedSolver:
    """A geodesic solver that reports to a clock."""

    solver: GeodesicSolver
    clock: StageClock

    def distances(self, sources: IntArray) -> FloatArray:
        """Measure distances, (S, N) float64."""
        with self.clock.stage("distances"):
            return self.solver.distances(sources)


@dataclass(frozen=True)
class TimedSolverFactory:
    """Builds solvers that report to a clock, and reports their building."""

    factory: Callable[[FloatArray, IntArray], GeodesicSolver]
    clock: StageClock

    def __call__(self, V: FloatArray, F: IntArray) -> TimedSolver:
        """Build a solver on V (N, 3) and F (F, 3)."""
        with self.clock.stage("distances"):
            return TimedSolver(self.factory(V, F), self.clock)


@dataclass(frozen=True)
class TimedRecipe(Recipe):
    """A recipe that builds schemes whose segmenter and solver report to a clock."""

    clock: StageClock = field(default_factory=StageClock)

    @classmethod
    def of(cls, recipe: Recipe, clock: StageClock) -> TimedRecipe:
        """Time what another recipe builds."""
        return cls(recipe.scheme, recipe.segmenter, recipe.geodesic, recipe.settings, clock)

    def build_segmenter(self) -> Segmenter:
        """Make the segmenter alone."""
        return TimedSegmenter(super().build_segmenter(), self.clock)

    def build_solver(self) -> Callable[[FloatArray, IntArray], GeodesicSolver]:
        """Make what builds geodesic solvers on meshes (V, F)."""
        return TimedSolverFactory(super().build_solver(), self.clock)
