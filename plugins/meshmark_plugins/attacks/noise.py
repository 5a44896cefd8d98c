"""Random displacement of every coordinate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark_plugins.attacks.frames import (
    PER,
    mean_radius,
    require_trajectories,
    treat_frames,
)
from meshmark_plugins.attacks.parameters import choice, number


@dataclass(frozen=True)
class Noise:
    """Add independent noise to every coordinate of every vertex.

    Parameters
    ----------
    amplitude : float
        Size of the noise as a fraction of d, the mean distance of a frame's vertices to their
        mean. Uniform noise lies in [-amplitude d, amplitude d]; Gaussian noise has this
        standard deviation. In [0, 1].
    kind : {"uniform", "gaussian"}
        Law of the noise; uniform is the benchmark's.
    per : {"frame", "animation"}
        Fresh noise for every frame, or one noise pattern that all frames share.

    Raises
    ------
    UsageError
        If a parameter is out of range.

    References
    ----------
    K. Wang, G. Lavoue, F. Denis, A. Baskurt, X. He, "A benchmark for 3D mesh watermarking",
    Shape Modeling International, 2010, doi:10.1109/SMI.2010.33.
    """

    amplitude: float = 0.001
    kind: str = "uniform"
    per: str = "frame"

    def __post_init__(self) -> None:
        object.__setattr__(self, "amplitude", number("noise", "amplitude", self.amplitude, 0, 1))
        choice("noise", "kind", self.kind, ("uniform", "gaussian"))
        choice("noise", "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the noisy animation."""
        if self.per == "animation":
            require_trajectories("noise", animation, "per='animation'")
        return treat_frames(
            animation,
            AddNoise(self.amplitude, self.kind),
            rng,
            alike=self.per == "animation",
        )


@dataclass(frozen=True)
class AddNoise:
    """Adds noise to one frame."""

    amplitude: float
    kind: str

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the noisy frame."""
        size = self.amplitude * mean_radius(frame.points)
        shape = frame.points.shape
        if self.kind == "uniform":
            noise = rng.uniform(-size, size, shape)
        else:
            noise = rng.normal(0.0, size, shape)
        return frame.moved(frame.points + noise)
