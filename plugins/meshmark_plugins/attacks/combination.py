"""Several attacks, one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshmark.errors import UsageError
from meshmark.extension.interfaces import Attack
from meshmark.extension.parameters import name_and_parameters
from meshmark.extension.registry import catalogue, check_parameters
from meshmark.mesh.animation import MeshAnimation


@dataclass(frozen=True)
class Combination:
    """Apply attacks in order, each to what the one before left.

    Parameters
    ----------
    attacks : str or sequence of Attack
        Names of any installed attacks, with parameters where wanted, joined by plus signs:
        "noise:amplitude=0.002,kind=gaussian+smoothing:iterations=5+similarity". A comma within
        a value is a semicolon here: "scale:factors=1;1.2;1". Or attacks already made.

    Raises
    ------
    UsageError
        If an attack or parameter is unknown or impossible.
    """

    attacks: str | Sequence[Attack] = "quantization:bits=12+smoothing:iterations=5+similarity"

    def __post_init__(self) -> None:
        if isinstance(self.attacks, str):
            for step in self.attacks.split("+"):
                read_step(step)
        elif not self.attacks or not all(isinstance(step, Attack) for step in self.attacks):
            raise UsageError("attack combination: attacks must be text, or attacks, at least one")

    def apply(self, animation: MeshAnimation, rng: np.random.Generator) -> MeshAnimation:
        """Return the animation after the last attack."""
        for attack in self._made():
            animation = attack.apply(animation, rng)
        return animation

    def _made(self) -> list[Attack]:
        if not isinstance(self.attacks, str):
            return list(self.attacks)
        return [make_step(step) for step in self.attacks.split("+")]


def make_step(text: str) -> Attack:
    """Make the attack that "NAME:PARAMETER=VALUE,..." describes."""
    name, parameters = read_step(text)
    offer = catalogue().find("attack", name)
    check_parameters(offer, parameters)
    return offer.record.factory(**parameters)


def read_step(text: str) -> tuple[str, dict[str, Any]]:
    """Take "NAME:PARAMETER=VALUE,..." apart.

    Raises
    ------
    UsageError
        If it is not of this form.
    """
    name, typed = name_and_parameters(
        text, lambda pair: f"attack combination: {pair!r} in {text!r} is not PARAMETER=VALUE"
    )
    if not name:
        raise UsageError("attack combination: an attack's name is missing")
    return name, {parameter: _value(value) for parameter, value in typed.items()}


def _value(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
