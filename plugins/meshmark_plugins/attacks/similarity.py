"""Moving, turning and scaling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark_plugins.attacks.frames import PER, mean_radius, treat_frames
from meshmark_plugins.attacks.parameters import choice, number


@dataclass(frozen=True)
class Similarity:
    """Scale, turn and move at random.

    Parameters
    ----------
    translation : float
        Each axis moves by a uniform amount within +-translation d, d being the mean distance
        of the vertices to their mean. In [0, 1000].
    scale_low, scale_high : float
        Bounds of the scale, which is log-uniform between them, so that shrinking is as likely
        as growing. In [0.001, 1000].
    per : {"frame", "animation"}
        A transform for each frame, as the benchmark treats single meshes, or one for all: what
        placing an asset in another scene does.

    Raises
    ------
    UsageError
        If a parameter is out of range.

    Notes
    -----
    The axis is uniform on the sphere and the angle in [0, 2 pi).

    References
    ----------
    K. Wang, G. Lavoue, F. Denis, A. Baskurt, X. He, "A benchmark for 3D mesh watermarking",
    Shape Modeling International, 2010, doi:10.1109/SMI.2010.33.
    """

    translation: float = 5.0
    scale_low: float = 0.1
    scale_high: float = 10.0
    per: str = "animation"

    def __post_init__(self) -> None:
        name = "similarity"
        translation = number(name, "translation", self.translation, 0, 1000)
        high = number(name, "scale_high", self.scale_high, 1e-3, 1e3)
        low = number(name, "scale_low", self.scale_low, 1e-3, high)
        object.__setattr__(self, "translation", translation)
        object.__setattr__(self, "scale_low", low)
        object.__setattr__(self, "scale_high", high)
        choice(name, "per", self.per, PER)

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the transformed animation."""
        if self.per == "frame":
            return treat_frames(animation, TransformAtRandom(self), rng)
        return animation.map(self.draw(animation[0], rng))

    def draw(self, frame: Frame, rng: np.random.Generator) -> Affine:
        """Draw a transform about the centre of a frame."""
        from scipy.spatial.transform import Rotation

        axis = rng.normal(size=3)
        turn = rng.uniform(0, 2 * np.pi) * axis / np.linalg.norm(axis)
        scale = np.exp(rng.uniform(np.log(self.scale_low), np.log(self.scale_high)))
        move = rng.uniform(-1, 1, 3) * self.translation * mean_radius(frame.points)
        matrix = scale * Rotation.from_rotvec(turn).as_matrix()
        return Affine(matrix, frame.points.mean(axis=0), move)


@dataclass(frozen=True, eq=False)
class Affine:
    """Maps points p to matrix (p - centre) + centre + move."""

    matrix: FloatArray
    centre: FloatArray
    move: FloatArray

    def __call__(self, frame: Frame) -> Frame:
        """Return the transformed frame."""
        P = (frame.points - self.centre) @ self.matrix.T
        return frame.moved(P + self.centre + self.move)


@dataclass(frozen=True)
class TransformAtRandom:
    """Transforms one frame by a transform of its own."""

    similarity: Similarity

    def __call__(self, frame: Frame, rng: np.random.Generator) -> Frame:
        """Return the transformed frame."""
        return self.similarity.draw(frame, rng)(frame)
