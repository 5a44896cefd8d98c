"""Positions stored in half precision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.errors import InputError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark_plugins.attacks.frames import treat_frames


@dataclass(frozen=True)
class Float16:
    """Round every coordinate to the nearest 16-bit float: 11 significant bits.

    Coordinates beyond 65504 do not fit: such a frame is an InputError when it is read.
    """

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the rounded animation."""
        return treat_frames(animation, HalfPrecision(), rng)


@dataclass(frozen=True)
class HalfPrecision:
    """Rounds one frame."""

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the rounded frame."""
        largest = float(np.abs(frame.points).max())
        if largest > float(np.finfo(np.float16).max):
            raise InputError(f"the coordinate {largest:g} does not fit into a 16-bit float")
        return frame.moved(frame.points.astype(np.float16).astype(np.float64))
