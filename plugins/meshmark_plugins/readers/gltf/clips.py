"""Animation clips: values that change over time, by the rules of their samplers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from meshmark.arrays import FloatArray, IntArray
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
class Tracks:
    """Values of the same kind over time, with keys at the same times.

    Parameters
    ----------
    times : (K,) float64
        Of the keys, in seconds, not decreasing.
    stored : (R, K, P, C) float
        What is stored of each value at each key: the value; of cubic splines, the tangent into
        it, the value, and the tangent out of it.
    interpolation : str
    are_rotations : bool
        Whether the values are quaternions: between keys, they go along the shorter arc.
    """

    times: FloatArray
    stored: NDArray[np.floating]
    interpolation: str
    are_rotations: bool

    @cached_property
    def values(self) -> FloatArray:
        """Values at the keys, (K, R, C)."""
        values = self._part(self.stored.shape[2] // 2)
        if self.are_rotations and self.interpolation != CUBIC:
            length = np.linalg.norm(values, axis=2, keepdims=True)
            values /= np.where(length == 0, 1.0, length)
        return values

    @cached_property
    def tangents(self) -> tuple[FloatArray, FloatArray]:
        """Tangents of cubic splines into and out of each key, (K, R, C)."""
        return self._part(0), self._part(2)

    def at(self, time: float, rows: IntArray | int) -> FloatArray:
        """Return some values at a time, (n, C); before the first key and after the last, theirs."""
        after = int(np.searchsorted(self.times, time, side="right"))
        for key in (after, after - 1):
            if 0 <= key < len(self.times) and abs(self.times[key] - time) <= SINGLE * abs(time):
                return self.values[key, rows]
        if after == 0 or after == len(self.times) or self.interpolation == STEP:
            return self.values[max(after - 1, 0), rows]
        span = self.times[after] - self.times[after - 1]
        t = (time - self.times[after - 1]) / span
        before, following = self.values[after - 1, rows], self.values[after, rows]
        if self.interpolation == CUBIC:
            into, out = self.tangents
            return (
                (2 * t**3 - 3 * t**2 + 1) * before
                + (t**3 - 2 * t**2 + t) * (out[after - 1, rows] * span)
                + (3 * t**2 - 2 * t**3) * following
                + (t**3 - t**2) * (into[after, rows] * span)
            )
        if self.are_rotations:
            return _along_arcs(before, following, t)
        return before + t * (following - before)

    def _part(self, part: int) -> FloatArray:
        return self.stored[:, :, part].swapaxes(0, 1).astype(np.float64, order="C")


# One value over time.
Row = tuple[Tracks, int]


@dataclass(frozen=True)
class Clip:
    """One animation of a document.

    Parameters
    ----------
    name : str
    tracks : mapping of str to mapping of int to (Tracks, int)
        By what changes, translation, rotation, scale, or weights, and by node: the values over
        time, and which row of them.
    notes : tuple of str
        What of it is not looked at.
    """

    name: str
    tracks: Mapping[str, Mapping[int, Row]]
    notes: tuple[str, ...] = ()

    @property
    def span(self) -> tuple[float, float]:
        """Time of the first and of the last key, in seconds."""
        rows = chain.from_iterable(of_nodes.values() for of_nodes in self.tracks.values())
        times = [tracks.times for tracks in {tracks for tracks, _ in rows}]
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
    samplers, channels = animation.objects("samplers"), animation.objects("channels")
    sampler_of = channels.indices("sampler", samplers)
    targets = channels.objects("target")
    paths = targets.texts("path")
    moving = targets.having("node")
    # Weights of a mesh without targets change nothing.
    wanted = {
        (node, path): sampler_of[channel]
        for channel, node in zip(moving, targets.chosen(moving).indices("node", nodes), strict=True)
        if (path := paths[channel]) in WIDTHS or (path == WEIGHTS and n_weights.get(node))
    }
    chosen = samplers.chosen(list(wanted.values()))
    timelines = map(key_times.number, chosen.indices("input", accessors.elements))
    outputs = chosen.indices("output", accessors.elements)
    kinds = chosen.choices("interpolation", INTERPOLATIONS, LINEAR)
    alike: dict[tuple[int, str, str, int], dict[int, int]] = {}
    for (node, path), timeline, output, kind in zip(wanted, timelines, outputs, kinds, strict=True):
        width = WIDTHS[path] if path in WIDTHS else n_weights[node]
        alike.setdefault((timeline, kind, path, width), {})[node] = output
    tracks: dict[str, dict[int, Row]] = {}
    for (timeline, kind, path, width), output_of in alike.items():
        times = key_times.different[timeline]
        found = _tracks(list(output_of.values()), times, kind, path, width, accessors)
        rows = {node: (found, row) for row, node in enumerate(output_of)}
        tracks.setdefault(path, {}).update(rows)
    unknown = dict.fromkeys(path for path in paths if path not in WIDTHS and path != WEIGHTS)
    notes = [f"changes of {path[:40]!a} over time are not read" for path in unknown]
    return Clip(name, tracks, tuple(notes))


def _tracks(
    outputs: Sequence[int],
    times: FloatArray,
    interpolation: str,
    path: str,
    width: int,
    accessors: Accessors,
) -> Tracks:
    parts = 3 if interpolation == CUBIC else 1
    # Weights are listed one by one.
    each, rows = (1, width) if path == WEIGHTS else (width, 1)
    listed = accessors.joined(outputs, each, len(times) * parts * rows)
    stored = listed.reshape(len(outputs), len(times), parts, width)
    return Tracks(times, stored, interpolation, path == "rotation")


class KeyTimes:
    """When keys are, by number: most samplers have the same keys, in accessors of their own.

    Parameters
    ----------
    accessors : Accessors

    Attributes
    ----------
    different : list of (K,) float64
        In seconds.
    """

    def __init__(self, accessors: Accessors) -> None:
        self._accessors = accessors
        self._of_accessor: dict[int, int] = {}
        self._of_bytes: dict[bytes, int] = {}
        self.different: list[FloatArray] = []

    def number(self, index: int) -> int:
        """Return the number of the times that are in an accessor."""
        if index not in self._of_accessor:
            self._of_accessor[index] = self._number(index)
        return self._of_accessor[index]

    def of_all(self, animations: Sequence[Element]) -> list[FloatArray]:
        """Return those of all samplers, each once."""
        for animation in animations:
            samplers = animation.objects("samplers")
            for index in samplers.indices("input", self._accessors.elements):
                self.number(index)
        return self.different

    def _number(self, index: int) -> int:
        accessor = self._accessors.elements[index]
        if stored_type(accessor).kind != "f":
            accessor.fail("componentType", "is of integers; times of keys are floats")
        stored = self._accessors.values(index, 1).tobytes()
        if stored not in self._of_bytes:
            times = self._accessors.numbers(index, 1)[:, 0].astype(np.float64)
            if (times[1:] < times[:-1]).any():
                raise InputError(f"{accessor.place}: times of keys decrease")
            self._of_bytes[stored] = len(self.different)
            self.different.append(times)
        return self._of_bytes[stored]


def _along_arcs(before: FloatArray, following: FloatArray, t: float) -> FloatArray:
    """Interpolate unit quaternions (n, 4) at constant angular speed."""
    cosine = np.einsum("ij,ij->i", before, following)[:, None]
    following = np.where(cosine < 0, -following, following)
    angle = np.arccos(np.minimum(np.abs(cosine), NEARLY_EQUAL))
    first, second = np.sin((1 - t) * angle) / np.sin(angle), np.sin(t * angle) / np.sin(angle)
    straight = before + t * (following - before)
    arc = first * before + second * following
    return np.where(np.abs(cosine) > NEARLY_EQUAL, straight, arc)
