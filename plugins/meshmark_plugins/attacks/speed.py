"""A change of playing speed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshmark.errors import UsageError
from meshmark.mesh.animation import MeshAnimation
from meshmark_plugins.attacks.frames import require_trajectories
from meshmark_plugins.attacks.parameters import flag, number
from meshmark_plugins.attacks.retiming import RetimedFrames, interpolate


@dataclass(frozen=True)
class Speed:
    """Play faster or slower.

    Parameters
    ----------
    factor : float
        2 plays twice as fast, 0.5 half as fast; in [0.1, 10].
    bake : bool
        Sample the faster animation at the old frame rate, with linear in-betweens, as an
        export would; otherwise only the time codes of the frames change.

    Raises
    ------
    UsageError
        If a parameter is out of range, there is but one frame, or in-betweens are wanted where
        the connectivity changes from frame to frame.
    """

    factor: float = 1.25
    bake: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "factor", number("speed", "factor", self.factor, 0.1, 10))
        object.__setattr__(self, "bake", flag("speed", "bake", self.bake))

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the faster animation, from the same first time code; what has no time stays."""
        if np.isnan(animation.times).all():
            return animation
        if len(animation) < 2:
            raise UsageError(
                "attack speed: one frame has no speed",
                source=animation.origin or None,
                prim=animation.prim,
            )
        times = animation.times
        begin = float(times[0])
        if not self.bake:
            stretched = begin + (times - begin) / self.factor
            n = len(times)
            steps = tuple(range(n))
            source = RetimedFrames(
                animation.source, tuple(stretched.tolist()), steps, steps, (0.0,) * n
            )
            return replace(animation, times=stretched, source=source)
        require_trajectories("speed", animation, "interpolation")
        step = float(np.median(np.diff(times)))
        # A hair of tolerance keeps the last frame where the new length is a whole number.
        n = int((times[-1] - begin) / self.factor / step + 1e-9) + 1
        baked = begin + step * np.arange(n, dtype=np.float64)
        at = begin + (baked - begin) * self.factor
        return interpolate(animation, range(len(times)), baked, at)
