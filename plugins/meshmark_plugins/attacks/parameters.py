"""Checks on attack parameters: a value comes back in its proper type, or a UsageError says why.

Values may be text, as a command line gives them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from meshmark.errors import UsageError


def number(
    attack: str,
    parameter: str,
    value: Any,
    low: float,
    high: float,
    *,
    low_open: bool = False,
    high_open: bool = False,
) -> float:
    """Return a real number within [low, high]; an open end is itself not allowed."""
    try:
        x = float(value)
    except (TypeError, ValueError):
        x = math.nan
    below = x <= low if low_open else x < low
    above = x >= high if high_open else x > high
    if isinstance(value, bool) or not math.isfinite(x) or below or above:
        opening = "(" if low_open or math.isinf(low) else "["
        closing = ")" if high_open or math.isinf(high) else "]"
        raise _refusal(attack, parameter, value, f"a number in {opening}{low:g}, {high:g}{closing}")
    return x


def whole(attack: str, parameter: str, value: Any, low: int, high: int) -> int:
    """Return an integer within [low, high]."""
    try:
        x = int(str(value))
    except ValueError:
        x = low - 1
    if isinstance(value, bool) or not low <= x <= high:
        raise _refusal(attack, parameter, value, f"a whole number in [{low}, {high}]")
    return x


def choice(attack: str, parameter: str, value: Any, allowed: Sequence[str]) -> str:
    """Return one of the allowed words."""
    if value not in allowed:
        raise _refusal(attack, parameter, value, f"one of {', '.join(allowed)}")
    return str(value)


def flag(attack: str, parameter: str, value: Any) -> bool:
    """Return a truth value; the words true, false, yes, no, 1 and 0 are understood."""
    words = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
    word = str(value).lower()
    if word not in words:
        raise _refusal(attack, parameter, value, "true or false")
    return words[word]


def vector(attack: str, parameter: str, value: Any) -> tuple[float, float, float]:
    """Return three finite numbers, from a sequence or from text such as "0,1,0"."""
    parts = value.split(",") if isinstance(value, str) else value
    try:
        x, y, z = (float(part) for part in parts)
    except (TypeError, ValueError):
        x = y = z = math.nan
    if not all(map(math.isfinite, (x, y, z))):
        raise _refusal(attack, parameter, value, "three numbers x,y,z")
    return x, y, z


def _refusal(attack: str, parameter: str, value: Any, allowed: str) -> UsageError:
    return UsageError(f"attack {attack}: {parameter} is {value!r}, but must be {allowed}")
