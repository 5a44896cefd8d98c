"""The parameters of the scheme, which whoever marks may choose."""

from __future__ import annotations

from dataclasses import dataclass

from meshmark.extension.parameters import require_number, require_whole

WHAT = "scheme apex"


@dataclass(frozen=True)
class Parameters:
    """Where chips lie, how strongly they are driven, and what that may cost.

    Parameters
    ----------
    bins : int
        K, bins (and chips) of each anchor; 2 to 64. Detection must know it.
    width : float
        P, width of a bin, in units (see `unit_series`); in (0, 0.5). Detection must know it.
    words : int
        Most anchors used, each with a code word of its own; 2 to 10. Detection must know it.
    strength : float
        Target of a chip, the mean sine of a bin less that of the bare surface; in (0, 1).
    max_mrms : float
        Limit to the mean distance of the marked surface from the original, the larger of both
        directions' RMS, as a share of the bounding box's diagonal; in (0, 0.1).
    hold : int
        Keyframe interval: fewest frames after which the displacement may have changed
        altogether; 1 to 10000. It is blended in between, so that the mark rests on the moving
        surface.
    """

    bins: int
    width: float
    words: int
    strength: float
    max_mrms: float
    hold: int

    def __post_init__(self) -> None:
        require_whole(WHAT, "bins", self.bins, 2, 64)
        require_number(WHAT, "width", self.width, 0.0, 0.5)
        require_whole(WHAT, "words", self.words, 2, 10)
        require_number(WHAT, "strength", self.strength, 0.0, 1.0)
        require_number(WHAT, "max_mrms", self.max_mrms, 0.0, 0.1)
        require_whole(WHAT, "hold", self.hold, 1, 10000)
