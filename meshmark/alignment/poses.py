"""The original in between its frames."""

from __future__ import annotations

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.mesh.animation import Frame, MeshAnimation


def posed(original: MeshAnimation, pose: float) -> Frame:
    """Blend the two frames about a real-valued index linearly.

    Parameters
    ----------
    original : MeshAnimation
        Of constant topology.
    pose : float
        Within [0, T - 1]; a whole number is that frame, exactly.
    """
    low, share = _split(original, pose)
    frame = original[low]
    if share == 0.0:
        return frame
    following = original[low + 1]
    time = (1.0 - share) * frame.time + share * following.time
    return Frame(time, (1.0 - share) * frame.points + share * following.points, frame.topology)


def motion(original: MeshAnimation, pose: float) -> FloatArray:
    """Compute the derivative of `posed` by the pose, (N, 3); at a whole number, of both sides."""
    low, share = _split(original, pose)
    first = max(low - 1, 0) if share == 0.0 else low
    last = min(low + 1, len(original) - 1)
    if first == last:
        return np.zeros_like(original[low].points)
    rate: FloatArray = (original[last].points - original[first].points) / (last - first)
    return rate


def _split(original: MeshAnimation, pose: float) -> tuple[int, float]:
    low = min(int(np.floor(pose)), len(original) - 1)
    return low, float(pose) - low
