"""How many frames of a copy are looked at before a verdict is asked for, and when to give up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from meshmark.extension.defaults import DEFAULT_LAYERS

Restored = Literal["none", "most", "all"]


@dataclass(frozen=True)
class Look:
    """How much of an animation is looked at before a verdict is asked for.

    Parameters
    ----------
    frames : int or None
        Number of frames, evenly spaced, beside those of smaller looks; None for all.
    restored : {"none", "most", "all"}
        Which amounts of smoothing are undone, too: of those the scheme asks for, none, the
        largest, or all.
    share : float
        Share of the false-positive rate it may spend.
    """

    frames: int | None
    restored: Restored
    share: float

    def restorations(self, wanted: Sequence[int]) -> tuple[int, ...]:
        """Choose among the iterations of smoothing that a scheme wants undone, 0 included."""
        largest = (max(wanted),) if self.restored == "most" else ()
        return tuple(wanted) if self.restored == "all" else tuple(dict.fromkeys((0, *largest)))

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


@dataclass(frozen=True)
class TakenLook:
    """A look that was taken, and what came of it.

    Parameters
    ----------
    schemes : tuple of str
        The schemes that looked.
    frames : int
        Most frames of a mesh that were looked at.
    restored : str
        Which amounts of smoothing were undone, too; see `Look`.
    log10_p : float
        Bound from this look, corrected for every search.
    """

    schemes: tuple[str, ...]
    frames: int
    restored: Restored
    log10_p: float

    def as_json(self) -> dict[str, Any]:
        """Return its entry under `looks` of a source."""
        return {**vars(self), "schemes": list(self.schemes)}


# Cheap looks, which say "marked" of nearly every copy that is, and leave no hope for nearly every
# one that is not. Undoing more smoothing than there was
# leaves hope, too.
QUICK = (Look(1, "none", 1 / 8), Look(1, "all", 1 / 8), Look(4, "most", 1 / 8))
# Half of the rate is kept for the look at everything: what few frames cannot show, all must.
THOROUGH = (Look(12, "all", 1 / 8), Look(None, "all", 1 / 2))
LOOKS = (*QUICK, *THOROUGH)
# Largest log10 of 1 / E that leaves hope, E the best e-value of the quick looks, corrected for
# every search but that of looks: above it, they are the last.
HOPE = 0.5
# Schemes of which it was measured what that loses; by others, copies are looked at whole.
GIVEN_UP = DEFAULT_LAYERS
# Whoever asks for several names wants all that are in any mesh or frame: what the look at
# everything did not spend is spent on that.
NAMING = Look(None, "none", 1 / 2)
# Where one look has to do: at what `verify` looks at before it looks at everything.
ONE_LOOK = replace(THOROUGH[0], share=1.0)
# The one look where the frames are given.
EVERYTHING = Look(None, "all", 1.0)
