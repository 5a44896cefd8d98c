"""A look at every frame before work begins, so that nothing is written for bad input."""

from __future__ import annotations

import numpy as np

from meshmark.errors import InputError, NoExtentError
from meshmark.mesh.animation import Frame, MeshAnimation
from meshmark.mesh.arrays import require_measurable
from meshmark.mesh.geometry import face_areas, surface_box

# Share of the squared diagonal below which a surface has no area: it is a point, or a line.
NO_AREA = 1e-12


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
        _require_extent(frame)
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


def _require_extent(frame: Frame) -> None:
    diagonal, centre = surface_box(frame.points, frame.faces)
    if diagonal < np.finfo(np.float32).tiny:
        raise NoExtentError("the mesh is scaled to nothing")
    # Of size 1 about the origin, or squares might underflow.
    unit = (frame.points - centre) / diagonal
    if face_areas(unit, frame.faces).sum() < NO_AREA:
        raise NoExtentError("the mesh is scaled to a line: it has no area")
