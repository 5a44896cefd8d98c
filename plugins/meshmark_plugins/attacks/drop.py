"""Frames that are missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import MeshAnimation
from meshmark_plugins.attacks.parameters import number


@dataclass(frozen=True)
class Drop:
    """Remove frames at random; the others keep their time codes.

    Parameters
    ----------
    share : float
        Fraction of the frames to remove, in [0, 1); one always stays.

    Raises
    ------
    UsageError
        If the parameter is out of range.
    """

    share: float = 0.25

    def __post_init__(self) -> None:
        share = number("drop", "share", self.share, 0, 1, high_open=True)
        object.__setattr__(self, "share", share)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the animation of the frames that stay."""
        n = len(animation)
        kept = max(1, n - round(self.share * n))
        return animation.select(np.sort(rng.permutation(n)[:kept]).tolist())
