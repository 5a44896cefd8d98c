"""Which time codes a clip is read at."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np

from meshmark.arrays import FloatArray
from meshmark.errors import InputError
from meshmark_plugins.readers.gltf.clips import Clip

# Below this rate, too much happens between frames: poses are not on straight lines between keys.
SLOWEST = 24.0
USUAL = 24.0
FASTEST = 1000.0
# Float32 seconds tell rates to about this share.
SAME_RATE = 1e-4
# Keys of an even rate are this close to it.
EVEN = 1e-2
# Share of a frame by which a key may miss a time code.
NEAR_FRAME = 1e-2
MOST_FRAMES = 100_000
# What a mesh may say of its keys, in its extras.
RATE, CODES = "timeCodesPerSecond", "timeCodes"


@dataclass(frozen=True, eq=False)
class Timeline:
    """The frames of a clip.

    Parameters
    ----------
    fps : float
        Time codes per second.
    codes : (T,) float64
        Time codes.
    begin : float
        When code 0 is, in seconds.
    """

    fps: float
    codes: FloatArray
    begin: float = 0.0

    def seconds(self, index: int) -> float:
        """Return the time of a frame."""
        return self.begin + float(self.codes[index]) / self.fps


# Of what has no time.
STILL = Timeline(USUAL, np.array([np.nan]))


def densest_rate(key_times: Iterable[FloatArray]) -> float:
    """Return the rate of the densest keys, per second; a multiple of it where it is below 24.

    Parameters
    ----------
    key_times : iterable of (K,) float64
        Of samplers, in seconds. Its spacing is the median one, so that two keys close together,
        as of a sudden change, do not count.
    """
    rates = [_rate(times) for times in key_times]
    densest = max((rate for rate in rates if rate), default=USUAL)
    return densest * math.ceil(SLOWEST / densest - EVEN)


def frames_of(clip: Clip, fps: float) -> Timeline:
    """List the whole time codes of a clip; the first key's alone if there is none within it.

    Raises
    ------
    InputError
        If there are too many.
    """
    begin, end = (time * fps for time in clip.span)
    first, last = math.ceil(begin - NEAR_FRAME), math.floor(end + NEAR_FRAME)
    if last < first:
        return Timeline(fps, np.array([begin]))
    if last - first >= MOST_FRAMES:
        raise InputError(
            f"the clip {clip.name[:40]!a} has more than {MOST_FRAMES} frames at {fps:g} a second"
        )
    return Timeline(fps, np.arange(first, last + 1, dtype=np.float64))


def told_frames(extras: object, keys: FloatArray) -> Timeline | None:
    """Return the frames that a mesh says it has; None if it says none that its keys are at.

    Parameters
    ----------
    extras : any JSON value
        Those of the mesh, whoever wrote them.
    keys : (K,) float64
        When its keys are, in seconds.
    """
    told = extras if isinstance(extras, dict) else {}
    fps, codes = told.get(RATE), told.get(CODES)
    if not _is_number(fps) or not isinstance(codes, list) or len(codes) != len(keys):
        return None
    if not 0 < fps <= FASTEST or not all(map(_is_number, codes)):
        return None
    times = np.array(codes, dtype=np.float64)
    if (np.diff(times) <= 0).any() or np.abs(times).max() > MOST_FRAMES * FASTEST:
        return None
    begins = keys - times / fps
    if np.ptp(begins) * fps > NEAR_FRAME:
        return None
    return Timeline(float(fps), times, float(begins[0]))


def _is_number(value: object) -> TypeGuard[float]:
    return type(value) in (int, float)


def _rate(times: FloatArray) -> float:
    """Return the rate of keys, a whole number where it is near one; 0 if there is none."""
    gaps = times[1:] - times[:-1]
    gaps = gaps[gaps > 0]
    if not len(gaps):
        return 0.0
    gaps.sort()
    usual = gaps[(len(gaps) - 1) // 2]
    rate = 1.0 / float(gaps[np.abs(gaps - usual) <= EVEN * usual].mean())
    whole = round(rate)
    return min(float(whole) if abs(rate - whole) <= SAME_RATE * rate else rate, FASTEST)
