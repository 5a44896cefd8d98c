"""Sources that take long."""

from __future__ import annotations

import numpy as np

from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.asset import Asset, as_asset
from meshmark.testing.meshes import icosphere


def slow_to_measure() -> Asset:
    """Return a ball of 10,242 points that waves for 120 frames: apex takes a while for each."""
    V, F = icosphere(5)
    frames = [V * (1 + 0.1 * np.sin(frame + 3 * V[:, :1])) for frame in range(120)]
    return as_asset(MeshAnimation.from_arrays(np.stack(frames), F, prim="/Ball"))
