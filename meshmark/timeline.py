"""Frame ranges as artists type them."""

from __future__ import annotations

import numpy as np

from meshmark.animation import MeshAnimation
from meshmark.errors import UsageError

# Stands for "as many frames as it takes".
AUTO = "auto"


def frames_in(animation: MeshAnimation, text: str | None) -> tuple[int, ...]:
    """Return the indices of the frames in a range A:B[:S] of time codes.

    Parameters
    ----------
    text : str or None
        A and B are time codes, both included, either may be empty; S keeps every S-th of the
        frames in between. None and "auto" stand for all.

    Raises
    ------
    UsageError
        If the text is not a range, or no frame lies in it.
    """
    if text is None or text == AUTO:
        return tuple(range(len(animation)))
    first, last, stride = _parse(text)
    inside = np.flatnonzero((animation.times >= first) & (animation.times <= last))[::stride]
    if inside.size == 0:
        raise UsageError(
            f"no frame lies in {text}; there are {len(animation)}, "
            f"from {animation.times[0]:g} to {animation.times[-1]:g}",
            source=animation.origin,
            prim=animation.prim,
        )
    return tuple(int(i) for i in inside)


def _parse(text: str) -> tuple[float, float, int]:
    fields = text.split(":")
    try:
        if len(fields) not in (2, 3):
            raise ValueError
        first = float(fields[0]) if fields[0] else -np.inf
        last = float(fields[1]) if fields[1] else np.inf
        stride = int(fields[2]) if len(fields) == 3 else 1
        if stride < 1 or not first <= last:
            raise ValueError
    except ValueError:
        raise UsageError(
            f"a frame range is A:B or A:B:S with A <= B and S >= 1, not {text!r}"
        ) from None
    return first, last, stride
