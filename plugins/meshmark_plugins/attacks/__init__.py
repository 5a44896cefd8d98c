"""Built-in attacks: what thieves, pipelines and accidents do to an animation.

Each lives in a module of its own, named after it; docs/attacks.md says what it models.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib import import_module
from typing import Any

from meshmark.errors import UsageError
from meshmark.hookspecs import AttackRecord, hookimpl


@dataclass(frozen=True)
class AttackFactory:
    """Imports an attack's module only when the attack is wanted, and builds it."""

    name: str
    module: str
    attack: str

    def __call__(self, **parameters: Any) -> Any:
        """Build the attack; raise UsageError for a parameter it does not have."""
        kind = getattr(import_module(f"{__name__}.{self.module}"), self.attack)
        known = [field.name for field in fields(kind)]
        for parameter in parameters:
            if parameter not in known:
                offer = f"it takes {', '.join(known)}" if known else "it takes none"
                raise UsageError(f"attack {self.name} has no parameter {parameter!r}: {offer}")
        return kind(**parameters)


def _record(
    name: str, attack: str, summary: str, parameters: Mapping[str, Any] | None = None
) -> AttackRecord:
    return AttackRecord(
        name=name,
        factory=AttackFactory(name, name.replace("-", "_"), attack),
        summary=summary,
        version="1",
        parameters=dict(parameters or {}),
    )


RECORDS = [
    _record(
        "noise",
        "Noise",
        "random displacement of every coordinate, a share of the mean distance to the centre",
        {"amplitude": 0.001, "kind": "uniform", "per": "frame"},
    ),
    _record(
        "cropping",
        "Cropping",
        "cuts a share of the vertices away with a plane",
        {"share": 0.1, "direction": None, "per": "animation"},
    ),
]


@hookimpl
def meshmark_attacks() -> list[AttackRecord]:
    """Offer the built-in attacks."""
    return list(RECORDS)
