"""Which bones carry the skin where, from the flesh on each bone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from creature.flesh import Capsule
from creature.skeleton import Skeleton
from meshmark.arrays import FloatArray

# Weights fall by 1/e over this fraction of the flesh's radius, so that a hip bends over a longer
# stretch than a fetlock.
_FALLOFF = 1.0


def nearness(V: FloatArray, skeleton: Skeleton, flesh: tuple[Capsule, ...]) -> FloatArray:
    """Weigh how near each bone's flesh is to each vertex.

    A vertex follows the bone whose flesh is nearest, and those up to two steps up or down its
    chain, so that skin does not follow a limb that merely passes by.

    Parameters
    ----------
    V : (N, 3) float64
        Rest positions.
    skeleton : Skeleton
        The bones.
    flesh : tuple of Capsule
        What hangs on them.

    Returns
    -------
    (N, B) float64
        1 for the nearest bone, less for the others, 0 for those of other chains.
    """
    distance = np.full((len(V), len(skeleton)), np.inf)
    for capsule in flesh:
        b = skeleton.index[capsule.bone]
        radius = max(capsule.radius_a, capsule.radius_b)
        distance[:, b] = np.minimum(distance[:, b], capsule.distance(V)[0] / radius)
    nearest = distance.argmin(axis=1)
    excess = distance - distance[np.arange(len(V)), nearest, None]
    return np.exp(-excess / _FALLOFF) * _related(skeleton)[nearest]


def _related(skeleton: Skeleton) -> NDArray[np.bool_]:
    """Tell which bones are at most two steps up or down one chain from each other, (B, B)."""
    bones = len(skeleton)
    up = np.zeros((bones, bones), dtype=bool)
    child = np.flatnonzero(skeleton.parents >= 0)
    up[child, skeleton.parents[child]] = True
    up |= up @ up
    return np.eye(bones, dtype=bool) | up | up.T
