"""The look every public door takes at the arrays of a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError

# What single precision can hold: far beyond, squares and products overflow even in double.
FARTHEST = np.finfo(np.float32).max


def mesh_arrays(V: ArrayLike, F: ArrayLike) -> tuple[FloatArray, IntArray]:
    """Return the arrays of a mesh in the types computation wants, or say what is wrong.

    Parameters
    ----------
    V : (N, 3) array_like of float
        Vertex positions.
    F : (F, 3) array_like of int
        Triangles, at least one; those without area and unused vertices are allowed.

    Returns
    -------
    V : (N, 3) float64
    F : (F, 3) int64
        Contiguous; copies only where a type differs.

    Raises
    ------
    InputError
        If a shape or a type is wrong, a coordinate is not finite, or an index is out of range.
    """
    points, faces = np.asarray(V), np.asarray(F)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points must have shape (N, 3), not {points.shape}")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise InputError(f"faces must have shape (F, 3), not {faces.shape}; triangulate first")
    if faces.dtype.kind not in "iu":
        raise InputError(f"faces must be integers, not {faces.dtype}")
    if points.dtype.kind not in "fiu":
        raise InputError(f"points must be real numbers, not {points.dtype}")
    if len(faces) == 0:
        raise InputError("the mesh has no faces")
    require_measurable(points)
    low, high = int(faces.min()), int(faces.max())
    if low < 0 or high >= len(points):
        raise InputError(
            f"face index {low if low < 0 else high} is out of range for {len(points)} points"
        )
    return (
        np.ascontiguousarray(points, dtype=np.float64),
        np.ascontiguousarray(faces, dtype=np.int64),
    )


def measurable(points: NDArray[Any]) -> NDArray[np.bool_]:
    """Tell of which points (N, 3) distances can be computed, (N,) bool."""
    # False for what is not a number, too.
    return (np.abs(points) <= FARTHEST).all(axis=1)


def require_measurable(points: NDArray[Any]) -> None:
    """Refuse points (N, 3) of which no distance can be computed.

    Raises
    ------
    InputError
        If a coordinate is not finite, or beyond what single precision can hold.
    """
    unfit = np.flatnonzero(~measurable(points))
    if len(unfit):
        first = points[unfit[0]]
        finite = np.isfinite(first).all()
        what = "too far from the origin to compute with" if finite else "not finite"
        raise InputError(f"point {unfit[0]} is {what}: {first.tolist()}")
