"""Lays layers of marks on one mesh, run by run where its connectivity changes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TypeAlias

from meshmark.detection.original_layout import OriginalLayout
from meshmark.embedding.mesh import Embedded, embed_animation
from meshmark.errors import CapacityError, MeshmarkError
from meshmark.extension.informed import InformedScheme
from meshmark.extension.interfaces import Scheme
from meshmark.extension.recipe import Recipe
from meshmark.keys import Key
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.runs import cut, joined, runs, span
from meshmark.workers.progress import FrameProgress

# Layers that a mesh cannot hold, and why.
Missing: TypeAlias = tuple[tuple[str, str], ...]


@dataclass(frozen=True, eq=False)
class Layer:
    """A scheme that marks, and its name."""

    name: str
    scheme: Scheme | InformedScheme

    @classmethod
    def of(cls, recipe: Recipe) -> Layer:
        """Build what a recipe says."""
        return cls(recipe.scheme, recipe.build())


def mark_layers(
    animation: MeshAnimation,
    layers: Sequence[Layer],
    key: Key,
    recipient: str | None,
    frames: tuple[int, ...],
    *,
    jobs: int,
    progress: FrameProgress | None,
) -> tuple[tuple[Embedded, ...], Missing, dict[int, MeshmarkError]]:
    """Mark a mesh by itself, or where its connectivity changes, each run of frames by itself.

    All runs hold the same words: they are one mesh.

    Returns
    -------
    layers : tuple of Embedded
        Of the whole animation.
    missing : tuple of (str, str)
        Layers it cannot hold, and why; or in how many of the runs.
    unheld : dict of int to MeshmarkError
        Frames of runs that can hold no layer.

    Raises
    ------
    CapacityError
        If no run can hold any; the first reason.
    """
    done: dict[range, tuple[Embedded, ...]] = {}
    missing: dict[str, list[str]] = {}
    unheld: dict[int, MeshmarkError] = {}
    alone, every = animation.constant_topology, runs(animation)
    for run in every:
        within = tuple(index - run.start for index in frames if index in run)
        part = cut(animation, run)
        if not within:
            continue
        try:
            done[run], refused = _mark(
                part, layers, key, recipient, within, jobs=jobs, progress=progress
            )
        except CapacityError as error:
            if alone:
                raise
            unheld.update({run.start + index: error for index in within})
            continue
        for name, reason in refused:
            missing.setdefault(name, []).append(
                reason if alone else f"frames {span(part)}: {reason}"
            )
    if not done:
        [(index, first), *_] = unheld.items()
        raise CapacityError(
            f"the connectivity changes over time, and none of {len(every)} runs of frames can hold "
            f"a mark: frame {animation.times[index]:g}: {first.message}",
            source=animation.origin,
            prim=animation.prim,
        )
    if alone:
        return done[every[0]], tuple((name, why) for name, [why] in missing.items()), {}
    told = ((name, f"{len(why)} of {len(every)} runs, {why[0]}") for name, why in missing.items())
    return _joined_layers(animation, layers, done), tuple(told), unheld


def _joined_layers(
    animation: MeshAnimation, layers: Sequence[Layer], done: Mapping[range, tuple[Embedded, ...]]
) -> tuple[Embedded, ...]:
    """Put the runs of an animation together, layer by layer."""
    latest = {run: cut(animation, run) for run in done}
    together = []
    for layer in layers:
        held = {run: e for run, several in done.items() for e in several if e.scheme == layer.name}
        if not held:
            continue
        latest |= {run: embedded.animation for run, embedded in held.items()}
        together.append(
            Embedded(
                joined(animation, list(latest), list(latest.values())),
                tuple(run.start + index for run, e in held.items() for index in e.frames),
                sum(embedded.carriers for embedded in held.values()),
                layer.name,
                isinstance(layer.scheme, InformedScheme),
            )
        )
    return tuple(together)


def _mark(
    animation: MeshAnimation,
    layers: Sequence[Layer],
    key: Key,
    recipient: str | None,
    frames: tuple[int, ...],
    *,
    jobs: int,
    progress: FrameProgress | None,
) -> tuple[tuple[Embedded, ...], Missing]:
    """Lay one layer upon the other, and tell which the mesh cannot hold.

    A blind layer beside an informed one holds the owner's words whoever the copy is for: no
    average of copies weakens what is the same in all.

    Raises
    ------
    CapacityError
        If it can hold none; the reason of the last layer, which asks least of a mesh.
    """
    informed = {
        layer.name: OriginalLayout(animation, layer.scheme)
        for layer in layers
        if isinstance(layer.scheme, InformedScheme)
    }
    done: list[Embedded] = []
    refused: list[tuple[str, CapacityError]] = []
    with ExitStack() as begun:
        for original in informed.values() if jobs > 1 else ():
            # Beside what other layers do one after the other; its own layer tells what is wrong.
            with suppress(CapacityError):
                original.begin()
            begun.callback(original.end)
        for layer in layers:
            for_all = bool(informed) and layer.name not in informed
            try:
                embedded = embed_animation(
                    done[-1].animation if done else animation,
                    layer.scheme,
                    layer.name,
                    key,
                    recipient=None if for_all else recipient,
                    frames=frames,
                    original=informed.get(layer.name),
                    jobs=jobs,
                    progress=progress,
                )
            except CapacityError as error:
                refused.append((layer.name, error))
            else:
                done.append(embedded)
    if not done:
        raise refused[-1][1]
    return tuple(done), tuple((name, error.message) for name, error in refused)
