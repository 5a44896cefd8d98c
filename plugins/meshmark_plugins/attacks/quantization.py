"""Rounding coordinates to a grid over the bounding box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark_plugins.attacks.frames import PER
from meshmark_plugins.attacks.parameters import choice, whole


@dataclass(frozen=True)
class Quantization:
    """Keep R bits of every coordinate.

    Parameters
    ----------
    bits : int
        R, in [1, 24]: each axis of the bounding box has 2^R evenly spaced positions, and
        coordinates go to the nearest.
    per : {"frame", "animation"}
        The bounding box of each frame, as the benchmark has it; or one box about all frames,
        as a file format that stores an animation would have it.

    Raises
    ------
    UsageError
        If a parameter is out of range.

    References
    ----------
    K. Wang, G. Lavoue, F. Denis, A. Baskurt, X. He, "A benchmark for 3D mesh watermarking",
    Shape Modeling International, 2010, doi:10.1109/SMI.2010.33.
    """

    bits: int = 10
    per: str = "frame"

    def __post_init__(self) -> None:
        object.__setattr__(self, "bits", whole("quantization", "bits", self.bits, 1, 24))
        choice("quantization", "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the quantized animation."""
        if self.per == "frame":
            return animation.map(RoundInOwnBox(self.bits))
        low, high = bounding_box(animation)
        return animation.map(RoundToGrid(low, (high - low) / (2**self.bits - 1)))


@dataclass(frozen=True, eq=False)
class RoundToGrid:
    """Rounds a frame's coordinates to low + k step, axis by axis; a step of 0 leaves them."""

    low: FloatArray
    step: FloatArray

    def __call__(self, frame: Frame) -> Frame:
        """Return the rounded frame."""
        V = frame.points
        moving = self.step > 0
        step = np.where(moving, self.step, 1.0)
        return frame.moved(np.where(moving, self.low + np.round((V - self.low) / step) * step, V))


@dataclass(frozen=True)
class RoundInOwnBox:
    """Rounds a frame's coordinates to a grid over its own bounding box."""

    bits: int

    def __call__(self, frame: Frame) -> Frame:
        """Return the rounded frame."""
        low, high = frame.points.min(axis=0), frame.points.max(axis=0)
        return RoundToGrid(low, (high - low) / (2**self.bits - 1))(frame)


def bounding_box(animation: MeshAnimation) -> tuple[FloatArray, FloatArray]:
    """Find the box about all frames of an animation, its low and its high corner."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for frame in animation:
        low = np.minimum(low, frame.points.min(axis=0))
        high = np.maximum(high, frame.points.max(axis=0))
    return low, high
