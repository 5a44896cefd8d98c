"""How many frames of a copy are looked at before a verdict is asked for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Look:
    """How much of an animation is looked at before a verdict is asked for.

    Parameters
    ----------
    frames : int or None
        Number of frames, evenly spaced, beside those of smaller looks; None for all.
    restored : bool
        Whether smoothing is undone, too.
    share : float
        Share of the false-positive rate it may spend.
    """

    frames: int | None
    restored: bool
    share: float

    def chosen(self, frames: Sequence[int], first: int) -> list[int]:
        """Spread the look evenly over `frames`, `first` and those of smaller looks included.

        A look at one frame is at `first`.
        """
        if self.frames is None:
            return list(frames)
        smaller = [n for look in LOOKS if (n := look.frames or 0) and 1 < n <= self.frames]
        total = len(frames)
        spread = [np.linspace(0, total - 1, min(n, total)).round().astype(int) for n in smaller]
        return sorted({first, *(frames[place] for places in spread for place in places)})


# Half of the rate is kept for the look at everything: what few frames cannot show, all must.
LOOKS = (
    Look(1, False, 1 / 8),
    Look(1, True, 1 / 8),
    Look(4, True, 1 / 8),
    Look(12, True, 1 / 8),
    Look(None, True, 1 / 2),
)
# Whoever asks for several names wants all that are in any mesh or frame: what the look at
# everything did not spend is spent on that.
NAMING = Look(None, False, 1 / 2)
# The one look where the frames are given.
EVERYTHING = Look(None, True, 1.0)
