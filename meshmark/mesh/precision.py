"""Whether the type that points are stored in, as far from the origin as they are, holds a mark.

Measured on two frames of the creature (3,002 points), moved away along all axes, marked, rounded to
float32 and verified: log10 p by `rounding`.

========  =======  =======  =======  =======  =======  =======
scheme    2e-8     8e-4     1.5e-3   3e-3     6e-3     1.2e-2
========  =======  =======  =======  =======  =======  =======
apex      -21.9             -22.7    -22.7    -13.3    0
tsai2014           -18.8    -19.1    -18.2    -10.1    -0.9
cho2007            -18.7    -6.4     0                 0
========  =======  =======  =======  =======  =======  =======

Moved along one axis only: apex -15.8 at 7e-3, 0 at 1.4e-2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from meshmark.arrays import IntArray
from meshmark.errors import CapacityError, OutputError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.geometry import surface_box

# Shares of the diagonal: where the weakest scheme begins to suffer, and where all have lost.
WEAKENED = 1e-3
LOST = 1e-2


def rounding(points: NDArray[np.floating], faces: IntArray) -> float | None:
    """Return how far apart the positions are that stored points can take.

    A transform to world space is in double precision: it loses nothing, however far it leads.

    Parameters
    ----------
    points : (N, 3) float16, float32 or float64
        As they are stored, in their own space and type.
    faces : (F, 3) int

    Returns
    -------
    float or None
        The distance between neighbouring numbers, root mean square over points and axes, as a
        share of the diagonal; None where that is 0.
    """
    diagonal = surface_box(points.astype(np.float64), faces)[0]
    steps = np.spacing(np.abs(points)).astype(np.float64)
    return float(np.sqrt(np.mean(steps**2))) / diagonal if diagonal else None


def rounding_of(animation: MeshAnimation, frame: Frame) -> float:
    """Return `rounding` of a frame of an animation; without any, of its world points."""
    if animation.rounding is not None:
        return animation.rounding
    return rounding(frame.points.astype(animation.dtype), frame.faces) or 0.0


def require_precision(animation: MeshAnimation, frame: Frame) -> tuple[str, ...]:
    """Refuse a mesh whose points are rounded so much that no mark survives being written.

    Parameters
    ----------
    frame : Frame
        One of the animation's.

    Returns
    -------
    tuple of str
        A warning where a mark is weakened.

    Raises
    ------
    CapacityError
        If it is lost.
    """
    share = rounding_of(animation, frame)
    if share <= WEAKENED:
        return ()
    lost = share > LOST
    diagonal = surface_box(frame.points, frame.faces)[0]
    told = (
        f"as far from the origin as they are, {animation.dtype} rounds its points to "
        f"{share * diagonal:.1g}, and a mark {'needs' if lost else 'suffers beyond'} "
        f"{(LOST if lost else WEAKENED) * diagonal:.1g}; move the mesh to the origin and put the "
        "offset into a transform, or store points as double3"
    )
    if lost:
        raise CapacityError(told)
    return (told,)


def stored(points: NDArray[np.floating], dtype: DTypeLike, **where: Any) -> NDArray[np.floating]:
    """Round points (N, 3) to the type they are written in.

    Raises
    ------
    OutputError
        If one is not finite, or too far from the origin for that type. It names `where`: source,
        prim and time.
    """
    if not np.isfinite(points).all():
        raise OutputError("a point is not finite", **where)
    with np.errstate(over="ignore"):
        rounded: NDArray[np.floating] = points.astype(dtype)
    if not np.isfinite(rounded).all():
        raise OutputError(f"a point is beyond the range of {rounded.dtype}", **where)
    return rounded
