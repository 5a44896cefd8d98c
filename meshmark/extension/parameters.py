"""Parameters of plugins: parsed from text, and checked, with messages that name them."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from numbers import Integral, Real
from typing import Any

from meshmark.errors import UsageError


def name_and_value(text: str, refusal: str) -> tuple[str, str]:
    """Parse NAME=VALUE; only the first sign of equality counts.

    Raises
    ------
    UsageError
        With the message `refusal`, if there is none.
    """
    name, equals, value = text.partition("=")
    if not equals:
        raise UsageError(refusal)
    return name, value


def name_and_parameters(text: str, refusal: Callable[[str], str]) -> tuple[str, dict[str, str]]:
    """Parse NAME:PARAMETER=VALUE,...; a semicolon stands for a comma in a value.

    Parameters
    ----------
    refusal : callable
        Makes the message about what stands between two commas and is not PARAMETER=VALUE.

    Raises
    ------
    UsageError
        If there is such a thing.
    """
    name, _, rest = text.strip().partition(":")
    pairs = [name_and_value(pair, refusal(pair)) for pair in rest.split(",") if pair]
    return name, {parameter.strip(): value.strip().replace(";", ",") for parameter, value in pairs}


def require_known(what: str, known: Collection[str], given: Iterable[str]) -> None:
    """Refuse parameters that a factory does not take.

    Parameters
    ----------
    what : str
        Kind and name for the message, such as "segmenter sdf".

    Raises
    ------
    UsageError
        If one of those given is not known; the message lists those there are.
    """
    for name in given:
        if name not in known:
            takes = ", ".join(sorted(known)) or "none"
            raise UsageError(f"{what} has no parameter {name!r}; it takes: {takes}")


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
    require_known(what, defaults, given)
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
