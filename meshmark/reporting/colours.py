"""Colours that people who see colours differently can tell apart, too."""

from __future__ import annotations

from functools import cache

import numpy as np

from meshmark.arrays import IntArray

# Every ninth of viridis, dark to light [1]_.
_VIRIDIS = (
    "#440154",
    "#482878",
    "#3e4989",
    "#31688e",
    "#26828e",
    "#1f9e89",
    "#35b779",
    "#6ece58",
    "#b5de2b",
    "#fde725",
)
# Of parts, one after the other [2]_.
PALETTE = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#0072b2", "#f0e442", "#d55e00", "#8b9199")
PLAIN = "#b9c0c9"
STEPS = 256


@cache
def heat_colours() -> tuple[str, ...]:
    """List the colours of a scale from 0 to 1 in `STEPS` steps, as CSS writes them.

    References
    ----------
    .. [1] S. van der Walt, N. Smith, "A better default colormap for Matplotlib", SciPy 2015.
    .. [2] M. Okabe, K. Ito, "Color universal design", 2008.
    """
    knots = np.array([rgb(each) for each in _VIRIDIS])
    at = np.linspace(0.0, 1.0, STEPS)
    places = np.linspace(0.0, 1.0, len(knots))
    channels = [np.interp(at, places, knots[:, i]).round().astype(int) for i in range(3)]
    return tuple(f"#{r:02x}{g:02x}{b:02x}" for r, g, b in zip(*channels, strict=True))


def rgb(colour: str) -> tuple[int, int, int]:
    """Read `#rrggbb`, 0 to 255 each."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def rgb_of(colours: tuple[str, ...]) -> IntArray:
    """Read several, (n, 3) int."""
    return np.array([rgb(each) for each in colours], dtype=np.int64)
