"""A piece cut out of an animation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import MeshAnimation
from meshmark_plugins.attacks.parameters import number


@dataclass(frozen=True)
class Window:
    """Keep consecutive frames only, with their time codes.

    Parameters
    ----------
    share : float
        Fraction of the frames to keep, in (0, 1]; at least one is kept.
    start : float, optional
        Where the window lies: 0 at the beginning, 1 at the end; at random if not given.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    share: float = 0.5
    start: float | None = None

    def __post_init__(self) -> None:
        share = number("window", "share", self.share, 0, 1, low_open=True)
        object.__setattr__(self, "share", share)
        if self.start is not None:
            object.__setattr__(self, "start", number("window", "start", self.start, 0, 1))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the animation of the window."""
        n = len(animation)
        kept = max(1, round(self.share * n))
        slack = n - kept
        drawn = int(rng.integers(slack + 1))
        first = drawn if self.start is None else round(self.start * slack)
        return animation.select(range(first, first + kept))
