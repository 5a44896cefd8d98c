"""A look at every frame before work begins, so that nothing is written for bad input."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import InputError, NoExtentError
from meshmark.mesh.animation import MeshAnimation
from meshmark.mesh.geometry import face_areas, surface_box

# Share of the squared diagonal below which a surface has no area: it is a point, or a line.
NO_AREA = 1e-12
# What single precision can hold: far beyond, squares and products overflow even in double.
FARTHEST = np.finfo(np.float32).max
# Below, a surface has no size. A Python number: comparing narrows the other side to numpy's type.
SMALLEST = float(np.finfo(np.float32).tiny)
# Faces that are looked at first.
FEW = 256


def check(animation: MeshAnimation) -> None:
    """Read every frame once, one at a time, and refuse a mesh that cannot be read as a whole.

    Parameters
    ----------
    animation : MeshAnimation
        From any reader.

    Raises
    ------
    InputError
        If a frame cannot be read, or faces had to be left out; it names file, prim and frame.
    """
    if animation.flaw:
        raise InputError(animation.flaw, source=animation.origin, prim=animation.prim)
    for _, error in bad_frames(animation):
        if not isinstance(error, NoExtentError):
            raise error


def bad_frames(animation: MeshAnimation) -> tuple[tuple[int, InputError], ...]:
    """Read every frame once, one at a time, and list those that nothing can be measured in.

    Parameters
    ----------
    animation : MeshAnimation
        From any reader.

    Returns
    -------
    tuple of (int, InputError)
        Index, and what is wrong, naming file, prim and frame. A `NoExtentError` is of a frame
        that can be read, but shows a mesh that was scaled to nothing.
    """
    found = ((index, _fault(animation, index)) for index in range(len(animation)))
    return tuple((index, error) for index, error in found if error is not None)


def _fault(animation: MeshAnimation, index: int) -> InputError | None:
    try:
        frame = animation[index]
        require_measurable(frame.points)
        require_extent(frame.points, frame.faces)
    except InputError as error:
        if error.source is not None:
            return error
        return type(error)(
            error.message,
            source=animation.origin,
            prim=animation.prim,
            time=float(animation.times[index]),
        )
    return None


def require_extent(V: FloatArray, F: IntArray) -> None:
    """Refuse a surface, V (N, 3) and F (F, 3), without an area.

    Raises
    ------
    NoExtentError
        If it is scaled to a point or to a line.
    """
    diagonal, centre = surface_box(V, F)
    if diagonal < SMALLEST:
        raise NoExtentError("the mesh is scaled to nothing")
    # Of size 1 about the origin, or squares might underflow.
    V = (V - centre) / diagonal
    # Mostly, some of the faces have enough.
    some = F[:: max(1, len(F) // FEW)]
    if face_areas(V, some).sum() < NO_AREA and face_areas(V, F).sum() < NO_AREA:
        raise NoExtentError("the mesh is scaled to a line: it has no area")


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
    # All at once: points are looked at one by one only where one is wrong.
    if not (np.abs(points) <= FARTHEST).all():
        index = int(np.argmin(measurable(points)))
        first = points[index]
        finite = np.isfinite(first).all()
        what = "too far from the origin to compute with" if finite else "not finite"
        raise InputError(f"point {index} is {what}: {first.tolist()}")
