"""Frames that show nothing, among those that do."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshmark.mesh.animation import Frame, FrameSource, MeshAnimation
from meshmark_plugins.attacks.frames import draw_seed
from meshmark_plugins.attacks.parameters import choice, number


@dataclass(frozen=True)
class Junk:
    """Scramble the points of some frames: each takes the place of a random other.

    Parameters
    ----------
    share : float
        Fraction of the frames to scramble, in (0, 1): at least one, and one always stays.
    where : {"start", "random"}
        The first frames, or frames at random.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    share: float = 0.5
    where: str = "start"

    def __post_init__(self) -> None:
        share = number("junk", "share", self.share, 0, 1, low_open=True, high_open=True)
        object.__setattr__(self, "share", share)
        choice("junk", "where", self.where, ("start", "random"))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the animation with some of its frames scrambled."""
        n = len(animation)
        order = np.arange(n) if self.where == "start" else rng.permutation(n)
        scrambled = min(n - 1, max(1, round(self.share * n)))
        which = frozenset(order[:scrambled].tolist())
        return replace(animation, source=ScrambledFrames(animation.source, which, draw_seed(rng)))


@dataclass(frozen=True)
class ScrambledFrames:
    """Frames of another source, some with their points in random order.

    Parameters
    ----------
    base : FrameSource
        The frames before.
    which : frozenset of int
        Indices of those to scramble.
    seed : int
        Seed of the orders.
    """

    base: FrameSource
    which: frozenset[int]
    seed: int

    def frame(self, index: int) -> Frame:
        """Read frame `index` of the base, and scramble it if its turn has come."""
        frame = self.base.frame(index)
        if index not in self.which:
            return frame
        return frame.moved(np.random.default_rng([self.seed, index]).permutation(frame.points))
