"""Animation clips: values that change over time, by the rules of their samplers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray
from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.accessors import Accessors, stored_type
from meshmark_plugins.readers.gltf.element import Element

STEP, LINEAR, CUBIC = INTERPOLATIONS = ("STEP", "LINEAR", "CUBICSPLINE")
WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
WEIGHTS = "weights"
# Keys are in single precision: a time that is so close to one, as a share of it, is that.
SINGLE = float(np.finfo(np.float32).eps)
# Above this cosine, quaternions are so close that a straight line is the arc, and safer to compute.
NEARLY_EQUAL = 0.9999


@dataclass(frozen=True, eq=False)
class Track:
    """One value over time.

    Parameters
    ----------
    times : (K,) float64
        Of the keys, in seconds, not decreasing.
    stored : (K, P, C) float
        What is stored of each key: its value; of cubic splines, the tangent into it, the value,
        and the tangent out of it.
    interpolation : str
    is_rotation : bool
        Whether the values are quaternions: between keys, they go along the shorter arc.
    """

    times: FloatArray
    stored: NDArray[np.floating]
    interpolation: str
    is_rotation: bool

    @cached_property
    def values(self) -> FloatArray:
        """Values at the keys, (K, C)."""
        values = self.stored[:, self.stored.shape[1] // 2].astype(np.float64)
        if self.is_rotation and self.tangents is None:
            length = np.linalg.norm(values, axis=1, keepdims=True)
            values /= np.where(length == 0, 1.0, length)
        return values

    @cached_property
    def tangents(self) -> FloatArray | None:
        """Tangents into and out of each key, (2, K, C), of cubic splines."""
        if self.interpolation != CUBIC:
            return None
        return np.stack([self.stored[:, 0], self.stored[:, 2]]).astype(np.float64)

    def at(self, time: float) -> FloatArray:
        """Return the value at a time, (C,); before the first key and after the last, theirs."""
        after = int(np.searchsorted(self.times, time, side="right"))
        for key in (after, after - 1):
            if 0 <= key < len(self.times) and abs(self.times[key] - time) <= SINGLE * abs(time):
                return self.values[key]
        if after == 0 or after == len(self.times) or self.interpolation == STEP:
            return self.values[max(after - 1, 0)]
        span = self.times[after] - self.times[after - 1]
        t = (time - self.times[after - 1]) / span
        before, following = self.values[after - 1], self.values[after]
        if self.tangents is not None:
            out, into = self.tangents[1, after - 1] * span, self.tangents[0, after] * span
            return (
                (2 * t**3 - 3 * t**2 + 1) * before
                + (t**3 - 2 * t**2 + t) * out
                + (3 * t**2 - 2 * t**3) * following
                + (t**3 - t**2) * into
            )
        if self.is_rotation:
            return _along_arc(before, following, t)
        return before + t * (following - before)


@dataclass(frozen=True)
class Clip:
    """One animation of a document.

    Parameters
    ----------
    name : str
    tracks : mapping of (int, str) to Track
        By node, and what of it changes: translation, rotation, scale, or weights.
    notes : tuple of str
        What of it is not looked at.
    """

    name: str
    tracks: Mapping[tuple[int, str], Track]
    notes: tuple[str, ...] = ()

    @property
    def span(self) -> tuple[float, float]:
        """Time of the first and of the last key, in seconds."""
        times = [track.times for track in self.tracks.values()]
        return min(each[0] for each in times), max(each[-1] for each in times)


def clip_names(animations: Sequence[Element]) -> tuple[str, ...]:
    """List what clips are called; by their number where they have no name, or another's."""
    names: dict[str, None] = {}
    for index, animation in enumerate(animations):
        name = animation.text("name", "")
        names[name if name and name not in names else f"animation{index}"] = None
    return tuple(names)


def read_clip(
    animation: Element,
    name: str,
    nodes: Sequence[Element],
    n_weights: Mapping[int, int],
    key_times: KeyTimes,
    accessors: Accessors,
) -> Clip:
    """Read one animation.

    Parameters
    ----------
    n_weights : mapping of int to int
        Number of morph targets of the nodes that have any.

    Raises
    ------
    InputError
        If a channel does not fit its sampler, or what it changes.
    """
    samplers = animation.objects("samplers")
    tracks: dict[tuple[int, str], Track] = {}
    unknown: dict[str, None] = {}
    for channel in animation.objects("channels"):
        sampler = samplers[channel.index("sampler", samplers)]
        target = channel.object("target")
        path = target.text("path")
        node = target.optional_index("node", nodes)
        if path not in WIDTHS and path != WEIGHTS:
            unknown[path] = None
        elif node is not None:
            width = n_weights.get(node, 0) if path == WEIGHTS else WIDTHS[path]
            # Weights of a mesh without targets change nothing.
            if width:
                tracks[node, path] = _track(sampler, path, width, key_times, accessors)
    notes = [f"changes of {path[:40]!a} over time are not read" for path in unknown]
    return Clip(name, tracks, tuple(notes))


def _track(
    sampler: Element, path: str, width: int, key_times: KeyTimes, accessors: Accessors
) -> Track:
    interpolation = sampler.one_of("interpolation", INTERPOLATIONS, LINEAR)
    times = key_times.of(sampler)
    parts = 3 if interpolation == CUBIC else 1
    output = sampler.index("output", accessors.elements)
    # Weights are listed one by one.
    each, rows = (1, width) if path == WEIGHTS else (width, 1)
    listed = accessors.numbers(output, each, count=len(times) * parts * rows)
    stored = listed.reshape(len(times), parts, width)
    return Track(times, stored, interpolation, path == "rotation")


class KeyTimes:
    """When keys are, in seconds: (K,) float64 of each accessor, read once for all its samplers.

    Parameters
    ----------
    accessors : Accessors
    """

    def __init__(self, accessors: Accessors) -> None:
        self._accessors = accessors
        self._read: dict[int, FloatArray] = {}

    def of(self, sampler: Element) -> FloatArray:
        """Return those of a sampler."""
        index = sampler.index("input", self._accessors.elements)
        if index not in self._read:
            accessor = self._accessors.elements[index]
            if stored_type(accessor).kind != "f":
                accessor.fail("componentType", "is of integers; times of keys are floats")
            times = self._accessors.numbers(index, 1)[:, 0].astype(np.float64)
            if (times[1:] < times[:-1]).any():
                raise InputError(f"{accessor.place}: times of keys decrease")
            self._read[index] = times
        return self._read[index]

    def of_all(self, animations: Sequence[Element]) -> list[FloatArray]:
        """Return those of all samplers, each accessor's once."""
        for animation in animations:
            for sampler in animation.objects("samplers"):
                self.of(sampler)
        return list(self._read.values())


def _along_arc(before: FloatArray, following: FloatArray, t: float) -> FloatArray:
    """Interpolate unit quaternions (4,) at constant angular speed."""
    cosine = float(before @ following)
    sign = -1.0 if cosine < 0 else 1.0
    if abs(cosine) > NEARLY_EQUAL:
        return before + t * (sign * following - before)
    angle = np.arccos(abs(cosine))
    weights = np.sin([(1 - t) * angle, t * angle]) / np.sin(angle)
    return weights[0] * before + weights[1] * sign * following
