"""Positions written as text with few digits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark_plugins.attacks.parameters import choice, whole


@dataclass(frozen=True)
class ObjDigits:
    """Round every coordinate to a number of decimal digits.

    Parameters
    ----------
    digits : int
        How many, in [1, 15].
    kind : {"fixed", "significant"}
        Digits after the point, as "%.4f" writes them, whose effect depends on the unit; or
        significant digits, as "%.4g" writes them.

    Raises
    ------
    UsageError
        If a parameter is out of range.
    """

    digits: int = 4
    kind: str = "fixed"

    def __post_init__(self) -> None:
        object.__setattr__(self, "digits", whole("obj-digits", "digits", self.digits, 1, 15))
        choice("obj-digits", "kind", self.kind, ("fixed", "significant"))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the rounded animation."""
        return animation.map(RoundDecimals(self.digits, self.kind))


@dataclass(frozen=True)
class RoundDecimals:
    """Rounds one frame."""

    digits: int
    kind: str

    def __call__(self, frame: Frame) -> Frame:
        """Return the rounded frame."""
        V = frame.points
        if self.kind == "fixed":
            return frame.moved(np.round(V, self.digits))
        size = np.where(V == 0.0, 1.0, np.abs(V))
        unit = 10.0 ** (np.floor(np.log10(size)) - self.digits + 1)
        return frame.moved(np.round(V / unit) * unit)
