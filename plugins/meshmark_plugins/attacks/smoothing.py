"""Laplacian smoothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.smoothing import polygon_umbrella, smooth
from meshmark_plugins.attacks.parameters import choice, number, whole

# Where Taubin's filter lets half of the signal pass, in eigenvalues of the umbrella operator.
_PASS_BAND = 0.1


@dataclass(frozen=True)
class Smoothing:
    """Move every vertex towards the mean of its neighbours, again and again.

    Vertices on a border stay. Neighbours are those along polygon edges.

    Parameters
    ----------
    iterations : int
        Number of steps, all vertices at once, in [0, 1000].
    kind : {"umbrella", "taubin"}
        Plain steps V += strength (mean of neighbours - V), as in the benchmark; or each
        followed by a step back of strength mu, which keeps the volume.
    strength : float
        Size of a step (lambda), in (0, 1]. The benchmark has 0.10; Taubin's filter is usually
        run at 0.3 to 0.6.

    Raises
    ------
    UsageError
        If a parameter is out of range.

    Notes
    -----
    Taubin's mu follows from 1/strength + 1/mu = 0.1.

    References
    ----------
    K. Wang, G. Lavoue, F. Denis, A. Baskurt, X. He, "A benchmark for 3D mesh watermarking",
    Shape Modeling International, 2010, doi:10.1109/SMI.2010.33.
    G. Taubin, "A signal processing approach to fair surface design", SIGGRAPH 1995,
    doi:10.1145/218380.218473.
    """

    iterations: int = 10
    kind: str = "umbrella"
    strength: float = 0.1

    def __post_init__(self) -> None:
        iterations = whole("smoothing", "iterations", self.iterations, 0, 1000)
        strength = number("smoothing", "strength", self.strength, 0, 1, low_open=True)
        object.__setattr__(self, "iterations", iterations)
        object.__setattr__(self, "strength", strength)
        choice("smoothing", "kind", self.kind, ("umbrella", "taubin"))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the smoothed animation."""
        steps = [self.strength]
        if self.kind == "taubin":
            steps.append(1.0 / (_PASS_BAND - 1.0 / self.strength))
        return animation.map(SmoothFrame(self.iterations, tuple(steps)))


@dataclass(frozen=True)
class SmoothFrame:
    """Smooths one frame by the same steps again and again."""

    iterations: int
    steps: tuple[float, ...]

    def __call__(self, frame: Frame) -> Frame:
        """Return the smoothed frame."""
        L = polygon_umbrella(frame.topology)
        V = frame.points
        for _ in range(self.iterations):
            for step in self.steps:
                V = smooth(V, L, 1, step)
        return frame.moved(V)
