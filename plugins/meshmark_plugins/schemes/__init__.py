"""Built-in watermarking schemes."""

from __future__ import annotations

from typing import Any

from meshmark.hookspecs import SchemeRecord, hookimpl

TSAI2014_DEFAULTS: dict[str, Any] = {
    "bits": 16,
    "strength": 0.05,
    "words": 8,
    "propagate": "adapt",
    "step": 0.3,
}


def _tsai2014(**parameters: Any) -> Any:
    from meshmark_plugins.schemes.tsai2014.scheme import Tsai2014

    return Tsai2014(**parameters)


@hookimpl
def meshmark_schemes() -> list[SchemeRecord]:
    """Offer the built-in schemes."""
    return [
        SchemeRecord(
            name="tsai2014",
            factory=_tsai2014,
            summary="mean geodesic distance to the cut between parts, moves along edges",
            version="1",
            parameters=TSAI2014_DEFAULTS,
        )
    ]
