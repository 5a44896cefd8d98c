"""Conformance suites a plugin author subclasses, and meshes to test on.

`AttackSuite`, `BinnedSchemeSuite`, `GeodesicSolverSuite`, `ReaderSuite`, `SchemeSuite` and
`SegmenterSuite` need pytest, which is imported only when one of them is asked for.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshmark.testing.attacks import AttackSuite
    from meshmark.testing.binned_schemes import BinnedSchemeSuite
    from meshmark.testing.geodesics import GeodesicSolverSuite
    from meshmark.testing.readers import ReaderSuite
    from meshmark.testing.schemes import SchemeSuite
    from meshmark.testing.segmenters import SegmenterSuite

__all__ = [
    "AttackSuite",
    "BinnedSchemeSuite",
    "GeodesicSolverSuite",
    "ReaderSuite",
    "SchemeSuite",
    "SegmenterSuite",
]

_HOMES = {
    "AttackSuite": "attacks",
    "BinnedSchemeSuite": "binned_schemes",
    "GeodesicSolverSuite": "geodesics",
    "ReaderSuite": "readers",
    "SchemeSuite": "schemes",
    "SegmenterSuite": "segmenters",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
