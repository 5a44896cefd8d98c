"""Checks on the parameters a plugin's factory is given, with messages that name them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from numbers import Integral, Real
from typing import Any

from meshmark.errors import UsageError


def with_defaults(
    what: str, defaults: Mapping[str, Any], given: Mapping[str, Any]
) -> dict[str, Any]:
    """Complete the given parameters with the defaults.

    Parameters
    ----------
    what : str
        Kind and name for the message, such as "segmenter sdf".
    defaults : mapping
        Every parameter the factory takes.
    given : mapping
        The ones the user chose.

    Raises
    ------
    UsageError
        If one is given that is not among the defaults; the message lists those there are.
    """
    for name in given:
        if name not in defaults:
            known = ", ".join(sorted(defaults)) or "none"
            raise UsageError(f"{what} has no parameter {name!r}; it takes: {known}")
    return {**defaults, **given}


def require_number(
    what: str, name: str, value: Any, low: float, high: float, *, low_allowed: bool = False
) -> None:
    """Refuse anything but a finite number between two others, which are themselves refused.

    With `low_allowed` the lower one is not.
    """
    number = not isinstance(value, bool) and isinstance(value, Real) and math.isfinite(value)
    if not (number and low <= value < high and (low_allowed or value != low)):
        above = "at least" if low_allowed else "above"
        raise UsageError(
            f"{what}: {name} must be a number {above} {low:g} and below {high:g}, not {value!r}"
        )


def require_whole(what: str, name: str, value: Any, low: int, high: int) -> None:
    """Refuse anything but a whole number from `low` to `high`."""
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not (whole and low <= int(value) <= high):
        raise UsageError(
            f"{what}: {name} must be a whole number from {low} to {high}, not {value!r}"
        )
