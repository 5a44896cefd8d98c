"""Time turned round."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshmark.mesh.animation import MeshAnimation
from meshmark_plugins.attacks.retiming import RetimedFrames


@dataclass(frozen=True)
class Reverse:
    """Play backwards: the last frame first, at mirrored time codes within the same range."""

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the reversed animation."""
        times = animation.times
        mirrored = times if len(times) == 1 else (times[0] + times[-1] - times)[::-1]
        order = tuple(reversed(range(len(times))))
        source = RetimedFrames(
            animation.source, tuple(mirrored.tolist()), order, order, (0.0,) * len(order)
        )
        return replace(animation, times=mirrored, source=source)
