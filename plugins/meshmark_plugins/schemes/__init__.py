"""Built-in watermarking schemes."""

from __future__ import annotations

from typing import Any

from meshmark.extension.hookspecs import SchemeRecord, hookimpl

APEX_DEFAULTS: dict[str, Any] = {
    "bins": 16,
    "width": 0.04,
    "words": 8,
    "strength": 0.36,
    "max_mrms": 2.2e-4,
    "hold": 4,
}

RELIEF_DEFAULTS: dict[str, Any] = {"max_mrms": 1e-4, "slope": 0.4}

TSAI2014_DEFAULTS: dict[str, Any] = {
    "bits": 16,
    "strength": 0.05,
    "words": 8,
    "propagate": "adapt",
    "step": 0.3,
    "picks": 10,
    "rehearsal": 10,
}

CHO2007_DEFAULTS: dict[str, Any] = {"bits": 64, "strength": 0.05}


def _apex(**parameters: Any) -> Any:
    from meshmark_plugins.schemes.apex.scheme import Apex

    return Apex(**parameters)


def _relief(**parameters: Any) -> Any:
    from meshmark_plugins.schemes.relief.scheme import Relief

    return Relief(**parameters)


def _tsai2014(**parameters: Any) -> Any:
    from meshmark_plugins.schemes.tsai2014.scheme import Tsai2014

    return Tsai2014(**parameters)


def _cho2007(**parameters: Any) -> Any:
    from meshmark_plugins.schemes.cho2007.scheme import Cho2007

    return Cho2007(**parameters)


@hookimpl
def meshmark_schemes() -> list[SchemeRecord]:
    """Offer the built-in schemes."""
    return [
        SchemeRecord(
            name="apex",
            factory=_apex,
            summary="density of the vertices about the tips of a shape, slid along its surface",
            version="1",
            parameters=APEX_DEFAULTS,
            needs=(),
        ),
        SchemeRecord(
            name="relief",
            factory=_relief,
            summary="a low relief on every surface, read against the original",
            version="1",
            parameters=RELIEF_DEFAULTS,
            needs=(),
            informed=True,
        ),
        SchemeRecord(
            name="tsai2014",
            factory=_tsai2014,
            summary="mean geodesic distance to the cut between parts, moves along edges",
            version="1",
            parameters=TSAI2014_DEFAULTS,
        ),
        SchemeRecord(
            name="cho2007",
            factory=_cho2007,
            summary="distance of the vertices to their centroid, moves towards and away from it",
            version="1",
            parameters=CHO2007_DEFAULTS,
            needs=(),
        ),
    ]
