"""How attacks act on animations: frame by frame with a seed each, or one connectivity for all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from scipy.sparse import csr_matrix

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import MeshmarkError, UsageError
from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation
from meshmark.mesh.topology import Topology

PER = ("frame", "animation")


class RandomFunction(Protocol):
    """Treats one frame, with randomness of its own. Must pickle."""

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the treated frame."""
        ...


@dataclass(frozen=True)
class SeededFrames:
    """Frames seen through a random function, the same whatever order they are asked in.

    Parameters
    ----------
    base : FrameSource
        The frames before.
    function : RandomFunction
        What happens to each.
    seed : int
        Seed of the whole animation.
    alike : bool
        Give every frame the same random numbers, instead of its own.
    origin, prim : str
        Where the frames come from, for messages.
    """

    base: FrameSource
    function: RandomFunction
    seed: int
    alike: bool = False
    origin: str = ""
    prim: str = "/"

    def frame(self, index: int) -> Frame:
        """Read frame `index` of the base and treat it."""
        frame = self.base.frame(index)
        rng = np.random.default_rng([self.seed, 0 if self.alike else index])
        with naming(self.origin, self.prim, frame.time):
            return self.function(frame, rng)


@dataclass(frozen=True, eq=False)
class KeepPoints:
    """Some of a frame's points under a new topology: a connectivity carried along trajectories."""

    indices: IntArray
    topology: Topology

    def __call__(self, frame: Frame) -> Frame:
        """Return the frame with only the kept points, in their new order."""
        return Frame(frame.time, frame.points[self.indices], self.topology)


@dataclass(frozen=True, eq=False)
class CombinePoints:
    """New points as weighted sums of a frame's points, under a new topology.

    Parameters
    ----------
    weights : (M, N) sparse
        Weights of the old points in each new one; rows sum to 1.
    topology : Topology
        Polygons over the M new points.
    """

    weights: csr_matrix
    topology: Topology

    def __call__(self, frame: Frame) -> Frame:
        """Return the frame with the new points."""
        return Frame(frame.time, np.asarray(self.weights @ frame.points), self.topology)


@contextmanager
def naming(origin: str, prim: str, time: float | None = None) -> Iterator[None]:
    """Give errors raised inside the file, prim and frame they do not name themselves."""
    try:
        yield
    except MeshmarkError as error:
        if error.source is not None:
            raise
        raise type(error)(error.message, source=origin or None, prim=prim, time=time) from error


def draw_seed(rng: np.random.Generator) -> int:
    """Draw the seed from which every frame's own randomness follows."""
    return int(rng.integers(2**63))


def treat_frames(
    animation: MeshAnimation,
    function: RandomFunction,
    rng: np.random.Generator,
    *,
    alike: bool = False,
    constant_topology: bool | None = None,
) -> MeshAnimation:
    """Return the animation seen lazily through a random function.

    Parameters
    ----------
    alike : bool
        Give every frame the same random numbers.
    constant_topology : bool, optional
        Whether the result has one; the animation's own by default.
    """
    constant = animation.constant_topology if constant_topology is None else constant_topology
    return replace(
        animation,
        source=SeededFrames(
            animation.source, function, draw_seed(rng), alike, animation.origin, animation.prim
        ),
        constant_topology=constant,
    )


def require_trajectories(attack: str, animation: MeshAnimation, reason: str) -> None:
    """Refuse an animation whose connectivity varies, where vertex j must be the same throughout."""
    if not animation.constant_topology:
        raise UsageError(
            f"attack {attack}: {reason} needs one connectivity for all frames, "
            "but this animation's changes from frame to frame",
            source=animation.origin or None,
            prim=animation.prim,
        )


def mean_radius(points: FloatArray) -> float:
    """Measure the mean distance of the vertices to their mean, the benchmark's unit of length."""
    return float(np.linalg.norm(points - points.mean(axis=0), axis=1).mean())
