"""Smooth waves through a shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import normalized
from meshmark_plugins.attacks.frames import PER, mean_radius, treat_frames
from meshmark_plugins.attacks.parameters import choice, number, whole


@dataclass(frozen=True)
class Wobble:
    """Displace a mesh by a sum of plane sine waves.

    Parameters
    ----------
    amplitude : float
        Largest displacement there can be, that of all waves together, as a fraction of d, the
        mean distance of a frame's vertices to their mean. In [0, 1].
    waves : int
        Number of waves, each as large as the others, with a random phase, a random direction
        it runs in and a random direction it displaces in. In [1, 100].
    wavelength : float
        Length of each wave, as a multiple of d. In [0.1, 100].
    per : {"frame", "animation"}
        New waves for every frame, or the same ones about the mean of each.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    amplitude: float = 0.01
    waves: int = 3
    wavelength: float = 2.0
    per: str = "animation"

    def __post_init__(self) -> None:
        amplitude = number("wobble", "amplitude", self.amplitude, 0, 1)
        wavelength = number("wobble", "wavelength", self.wavelength, 0.1, 100)
        object.__setattr__(self, "amplitude", amplitude)
        object.__setattr__(self, "waves", whole("wobble", "waves", self.waves, 1, 100))
        object.__setattr__(self, "wavelength", wavelength)
        choice("wobble", "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the wobbling animation."""
        waves = AddWaves(self.amplitude, self.waves, self.wavelength)
        return treat_frames(animation, waves, rng, alike=self.per == "animation")


@dataclass(frozen=True)
class AddWaves:
    """Displaces one frame."""

    amplitude: float
    waves: int
    wavelength: float

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the displaced frame."""
        V = frame.points
        d = mean_radius(V)
        running, displacing = normalized(rng.normal(size=(2 * self.waves, 3))).reshape(2, -1, 3)
        phase = rng.uniform(0.0, 2.0 * np.pi, self.waves)
        run = (V - V.mean(axis=0)) @ running.T / (self.wavelength * d) if d else 0.0
        waves = np.sin(2.0 * np.pi * run + phase) @ displacing
        return frame.moved(V + self.amplitude * d / self.waves * waves)
