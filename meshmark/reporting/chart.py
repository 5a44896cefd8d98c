"""Bars of evidence, one a frame, as numbers that a drawing is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass

from meshmark.reporting.facts import Series
from meshmark.reporting.wording import log10

WIDTH, HEIGHT = 720.0, 190.0
LEFT, RIGHT, TOP, BOTTOM = 54.0, 42.0, 12.0, 30.0
# Frames that have a bar; of more, these are spread evenly. Times that are written below.
MOST_BARS, MOST_TIMES = 240, 9
# Steps between marks of the axis, in decades.
STEPS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
MOST_MARKS = 5


@dataclass(frozen=True)
class Bar:
    """One frame: a box, and what it stands for."""

    x: float
    y: float
    width: float
    height: float
    told: str


@dataclass(frozen=True)
class Chart:
    """A drawing of `WIDTH` by `HEIGHT`.

    Parameters
    ----------
    name : str
    told : str
        What it shows, for those who do not see it.
    bars : tuple of Bar
    marks : tuple of (float, str)
        Height and label of each mark of the axis.
    times : tuple of (float, str)
        Place and label of each time code.
    limit : float or None
        Height of the line at the limit, if that is in the drawing.
    """

    name: str
    told: str
    bars: tuple[Bar, ...]
    marks: tuple[tuple[float, str], ...]
    times: tuple[tuple[float, str], ...]
    limit: float | None
    width: float = WIDTH
    height: float = HEIGHT
    left: float = LEFT
    right: float = WIDTH - RIGHT
    base: float = HEIGHT - BOTTOM


def chart(series: Series, limit: float) -> Chart:
    """Draw the evidence of a mesh: the lower p, the higher the bar.

    Parameters
    ----------
    series : Series
    limit : float
        log10 of the false-positive rate.
    """
    decades = [min(-p, STEPS[-1] * MOST_MARKS) + 0.0 for p in series.log10_p]
    n = len(decades)
    shown = range(n) if n <= MOST_BARS else [i * n // MOST_BARS for i in range(MOST_BARS)]
    top = max(max(decades), -limit, 1.0)
    step = next((each for each in STEPS if top / each <= MOST_MARKS), STEPS[-1])
    top = step * math.ceil(top / step)
    unit = (HEIGHT - TOP - BOTTOM) / top
    base = HEIGHT - BOTTOM
    pitch = (WIDTH - LEFT - RIGHT) / len(shown)
    width = min(0.7 * pitch, 28.0)
    bars = tuple(
        Bar(
            round(LEFT + pitch * (place + 0.5) - width / 2, 2),
            round(base - unit * decades[i], 2),
            round(width, 2),
            round(unit * decades[i], 2),
            f"time {series.times[i]}: log10 p {log10(series.log10_p[i])}",
        )
        for place, i in enumerate(shown)
    )
    every = math.ceil(len(bars) / MOST_TIMES)
    times = tuple(
        (round(LEFT + pitch * (place + 0.5), 2), series.times[shown[place]])
        for place in range(0, len(bars), every)
    )
    marks = tuple(
        (round(base - unit * mark, 2), log10(0.0 - mark).removesuffix(".00"))
        for mark in range(0, int(top) + 1, step)
    )
    strongest = max(range(n), key=lambda i: decades[i])
    told = (
        f"log10 p of {n} frames, each by itself: from {log10(max(series.log10_p))} to "
        f"{log10(min(series.log10_p))}, the strongest at time {series.times[strongest]}"
    )
    return Chart(series.name, told, bars, marks, times, round(base + unit * limit, 2))
