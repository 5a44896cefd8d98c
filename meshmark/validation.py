"""A look at every frame before work begins, so that nothing is written for bad input."""

from __future__ import annotations

import numpy as np

from meshmark.animation import MeshAnimation
from meshmark.errors import InputError


def check(animation: MeshAnimation) -> None:
    """Read every frame once, one at a time, and let the first unfit one raise.

    Parameters
    ----------
    animation : MeshAnimation
        From any reader; one that checks its frames as it reads them raises by itself.

    Raises
    ------
    InputError
        Naming file, prim and frame.
    """
    for frame in animation:
        finite = np.isfinite(frame.points).all(axis=1)
        if not finite.all():
            first = int(np.flatnonzero(~finite)[0])
            raise InputError(
                f"point {first} is not finite: {frame.points[first].tolist()}",
                source=animation.origin,
                prim=animation.prim,
                time=frame.time,
            )
