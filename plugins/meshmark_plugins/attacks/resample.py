"""Fewer frames, and linear in-betweens instead of the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import MeshAnimation
from meshmark_plugins.attacks.frames import require_trajectories
from meshmark_plugins.attacks.parameters import whole
from meshmark_plugins.attacks.retiming import interpolate


@dataclass(frozen=True)
class Resample:
    """Keep every k-th frame and the last, and restore the others by linear interpolation.

    Parameters
    ----------
    factor : int
        k, in [1, 1000]; 2 halves the rate.

    Raises
    ------
    UsageError
        If the parameter is out of range, or the connectivity changes from frame to frame.

    References
    ----------
    J.-S. Tsai, J.-T. Hsiao, W.-B. Huang, Y.-H. Kuo, "Geodesic-based robust blind watermarking
    method for three-dimensional mesh animation by using mesh segmentation and vertex
    trajectory", ICASSP 2014.
    """

    factor: int = 2

    def __post_init__(self) -> None:
        object.__setattr__(self, "factor", whole("resample", "factor", self.factor, 1, 1000))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the resampled animation, as many frames at the same times."""
        require_trajectories("resample", animation, "interpolation")
        last = len(animation) - 1
        keys = sorted({*range(0, last + 1, self.factor), last})
        return interpolate(animation, keys, animation.times, animation.times)
