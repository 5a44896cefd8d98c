"""Velocities and accelerations of points: what a mark adds to them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom

from meshmark.arrays import FloatArray
from meshmark.mesh.precision import stored
from meshmark.usd.authoring import MarkedFrames
from meshmark.usd.geometry import POINT_ARRAYS, connectivity_changes, time_code
from meshmark.usd.layers import StreamedLayer
from meshmark.usd.points import MeshPoints

# A time, and the first and second derivative (N, 3) there.
Rates = tuple[float, FloatArray, FloatArray]


def author_velocities(
    target: StreamedLayer, over: Sdf.PrimSpec, points: MeshPoints, frames: MarkedFrames
) -> None:
    """Add to velocities and accelerations of a prim what the move of its points adds over time.

    They are written at the times of the points, for which USD defines them. Nothing
    is written where they are missing or do not fit the points, where these do not move with time,
    are moved by a rig, or have other faces at other times.

    Parameters
    ----------
    target : StreamedLayer
        Lies over the stage of the prim.
    over : Sdf.PrimSpec
        Where the prim is in it.
    points : MeshPoints
        The prim.
    frames : MarkedFrames
        Its points before and after.
    """
    mesh, times = UsdGeom.Mesh(points.prim), frames.times
    # A rig does not move the velocities of a rest pose.
    if points.rig is not None or len(times) < 2:
        return
    if connectivity_changes(points.prim, points.times()):
        return
    offered = [
        (attribute, order)
        for order, attribute in ((1, mesh.GetVelocitiesAttr()), (2, mesh.GetAccelerationsAttr()))
        if _fits(attribute, times, len(points.local(times[0])))
    ]
    for attribute, order in offered:
        scale = points.prim.GetStage().GetTimeCodesPerSecond() ** order
        if not any(np.any(rates[order]) for rates in _rates(frames)):
            continue
        spec = Sdf.AttributeSpec(over, attribute.GetName(), attribute.GetTypeName())
        for rates in _rates(frames):
            before: NDArray[np.floating] = np.asarray(attribute.Get(rates[0]))
            after = before + scale * rates[order]
            target.set_vectors(spec, rates[0], stored(after, before.dtype))


def _fits(attribute: Usd.Attribute, times: Sequence[float], n_points: int) -> bool:
    """Tell whether an attribute has a vector for each point at all times."""
    if not attribute.HasAuthoredValue():
        return False
    values = (attribute.Get(time_code(time)) for time in times)
    return all(
        isinstance(value, POINT_ARRAYS)
        and len(value) == n_points
        and bool(np.all(np.isfinite(np.asarray(value))))
        for value in values
    )


def _rates(frames: MarkedFrames) -> Iterator[Rates]:
    moves = ((t, (after - before).astype(np.float64)) for t, before, after in frames)
    return derivatives(moves)


def derivatives(samples: Iterable[tuple[float, FloatArray]]) -> Iterator[Rates]:
    """Yield each time with the first and second derivative of samples by time.

    They are those of the parabola through a sample and its neighbours; at either end, through the
    three that are nearest. Two samples make a line. Holds three at a time.

    Parameters
    ----------
    samples : iterable of (float, array)
        At least two, by increasing time.
    """
    window: list[tuple[float, FloatArray]] = []
    for n, sample in enumerate(samples):
        window = [*window[-2:], sample]
        if n == 2:
            yield _derivatives(window, 0)
        if n >= 2:
            yield _derivatives(window, 1)
    if len(window) == 2:
        yield _derivatives(window, 0)
    yield _derivatives(window, len(window) - 1)


def _derivatives(window: Sequence[tuple[float, FloatArray]], at: int) -> Rates:
    """Differentiate the polynomial through samples at the time of one, in Lagrange's form."""
    times = [time for time, _ in window]
    first, second = np.zeros_like(window[0][1]), np.zeros_like(window[0][1])
    for j, (time, value) in enumerate(window):
        others = [each for k, each in enumerate(times) if k != j]
        scale = value / np.prod([time - each for each in others])
        # (t - a)(t - b) has the derivatives (t - a) + (t - b) and 2.
        first += scale * (sum(times[at] - each for each in others) if len(others) == 2 else 1.0)
        second += scale * (2.0 if len(others) == 2 else 0.0)
    return times[at], first, second
