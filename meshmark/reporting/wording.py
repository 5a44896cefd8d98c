"""Probabilities and lengths in words that everybody reads alike."""

from __future__ import annotations

import math
from collections.abc import Sequence

# Nobody draws a certain one of all keys more seldom than that, whatever a bound says.
KEYS = 256 * math.log10(2.0)
# Up to this power of ten, odds are written out.
WRITTEN_OUT = 15
# A blank at which no line is broken.
NARROW = "\u202f"
SUPERSCRIPT = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")


def odds(log10_p: float) -> str:
    """Write a bound on a probability as "1 in N", N rounded down to two digits.

    >>> odds(-6.0), odds(-7.31), odds(-0.2), odds(-40.5), odds(-500.0)
    ('1 in 1,000,000', '1 in 20,000,000', 'no bound: 1', '1 in 3 × 10⁴⁰', '1 in 10⁷⁷')
    """
    # Of what was computed in floating point, the last digits say nothing.
    exponent = min(-log10_p, KEYS) + 1e-9
    if exponent < math.log10(2.0):
        return "no bound: 1"
    power = math.floor(exponent)
    if power <= WRITTEN_OUT:
        unit = 10 ** max(0, power - 1)
        return f"1 in {math.floor(10.0**exponent / unit) * unit:,}"
    digit = math.floor(10.0 ** (exponent - power))
    times = f"{digit} × " if digit > 1 else ""
    return f"1 in {times}10{str(power).translate(SUPERSCRIPT)}"


def this_very_key(log10_p: float) -> str:
    """Explain odds that are those of drawing one key of all there are; else nothing."""
    drawn = ", which is the chance to draw this very key: there are no more than 2²⁵⁶"
    return drawn if -log10_p >= KEYS else ""


def factor(log10_x: float) -> str:
    """Write what p is multiplied by."""
    x = 10.0**log10_x
    return f"× {x:,.0f}" if x >= 100 else f"× {x:.3g}"


def percent(share: float) -> str:
    r"""Write a share of the diagonal, or of anything, in per cent.

    >>> percent(0.000213), percent(0.5)
    ('0.0213\u202f%', '50\u202f%')
    """
    return "unknown" if math.isnan(share) else f"{100.0 * share:.3g}{NARROW}%"


def log10(value: float) -> str:
    """Write a logarithm."""
    return f"{value + 0.0:.2f}".replace("-", "−")


def time_code(time: float) -> str:
    """Write a time code; of what has no time, nothing."""
    return "no time" if math.isnan(time) else f"{time:g}".replace("-", "−")


def listed(names: Sequence[str], most: int = 8) -> str:
    """List names: "A, B and C".

    >>> listed(["A"]), listed(["A", "B", "C"])
    ('A', 'A, B and C')
    """
    shown = list(names[:most])
    if len(names) > most:
        shown.append(f"{len(names) - most} more")
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"
