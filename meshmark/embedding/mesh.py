"""Marks one mesh: a plan for all its frames, then frame after frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from meshmark.arrays import FloatArray, IntArray, SignArray
from meshmark.detection.original_layout import OriginalLayout
from meshmark.errors import CapacityError, InputError, MeshmarkError
from meshmark.extension.informed import (
    InformedLayout,
    InformedScheme,
    signs_of,
)
from meshmark.extension.interfaces import MarkingPlan, Scheme
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.breakdown import breakdown_means_no_capacity
from meshmark.mesh.geometry import surface_box
from meshmark.mesh.precision import require_precision, rounding_of
from meshmark.mesh.welding import Welding
from meshmark.workers.ordered_map import ordered_map, sharing_workers
from meshmark.workers.progress import FrameProgress
from meshmark.workers.scratch import DisplacedFrames, ScratchFile


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
    scheme : str
        What marked it.
    informed : bool
        Whether that reads copies beside the original.
    """

    animation: MeshAnimation
    frames: tuple[int, ...]
    carriers: int
    scheme: str
    informed: bool


@sharing_workers
def embed_animation(
    animation: MeshAnimation,
    scheme: Scheme | InformedScheme,
    scheme_name: str,
    key: Key,
    *,
    recipient: str | None = None,
    frames: tuple[int, ...] | None = None,
    original: OriginalLayout | None = None,
    jobs: int = 1,
    progress: FrameProgress | None = None,
) -> Embedded:
    """Mark one mesh.

    Parameters
    ----------
    frames : tuple of int, optional
        Indices of the frames to mark; all by default.
    original : OriginalLayout, optional
        Where an informed scheme's chips lie on what `animation` was before other layers marked it.
    jobs : int
        Processes that work, this one among them.
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
    scratch = ScratchFile.create(len(animation), first.topology.n_points)
    try:
        doubts = require_precision(animation, first)
        some = animation.select(chosen)
        with breakdown_means_no_capacity():
            if isinstance(scheme, InformedScheme):
                signs = partial(signs_of, key, scheme_name, recipient=recipient)
                original = original or OriginalLayout(animation, scheme)
                work = plan_informed(some, original, signs, jobs=jobs)
            else:
                words = key.words(scheme_name, scheme.n_words, scheme.n_chips, recipient)
                generator = key.generator(f"embed/{scheme_name}")
                step = rounding_of(animation, first) * surface_box(first.points, first.faces)[0]
                work = plan_marking(some, scheme, words, generator=generator, step=step, jobs=jobs)
    except CapacityError as error:
        raise CapacityError(error.message, source=animation.origin, prim=animation.prim) from None
    displacements = ordered_map(work, range(len(chosen)), jobs=jobs, light=True)
    for done, (index, displacement) in enumerate(zip(chosen, displacements, strict=True), start=1):
        scratch.write(index, displacement)
        if progress is not None:
            progress(done, len(chosen))
    marked = replace(
        animation,
        source=DisplacedFrames(animation.source, scratch),
        notes=(*animation.notes, *doubts),
    )
    informed = isinstance(scheme, InformedScheme)
    return Embedded(marked, chosen, work.carriers, scheme_name, informed)


def plan_marking(
    animation: MeshAnimation,
    scheme: Scheme,
    words: IntArray,
    *,
    generator: np.random.Generator,
    step: float,
    jobs: int,
) -> MarkFrame:
    """Let a scheme plan all frames of an animation, as analysis sees them; see `Scheme.plan`."""
    welding = Welding.of(animation[0])
    analysed = animation.map(welding.frame)
    plan = scheme.plan(analysed, words, generator=generator, step=step, jobs=jobs)
    return MarkFrame(animation, welding, plan)


def plan_informed(
    animation: MeshAnimation,
    original: OriginalLayout,
    signs: Callable[[InformedLayout], SignArray],
    *,
    jobs: int,
) -> MarkFrame:
    """Let an informed scheme plan all frames of an animation; see `InformedScheme.plan`.

    Parameters
    ----------
    original : OriginalLayout
        Where the scheme's chips lie on what `animation` was before other layers marked it.
    signs : callable
        Derives the chips' signs for a layout.
    """
    welding, layout = original.welding, original.layout
    seen = animation.map(welding.frame)
    plan = original.scheme.plan(seen, layout, signs(layout), jobs=jobs)
    return MarkFrame(animation, welding, plan)


@dataclass(frozen=True, eq=False)
class MarkFrame:
    """Marks frame after frame of an animation by a scheme's plan."""

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
