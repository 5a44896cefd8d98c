"""Built-in geodesic solvers: heat for daily use, dijkstra for a bound, exact for reference."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from meshmark.extension.hookspecs import GeodesicSolverRecord, hookimpl
from meshmark.extension.parameters import with_defaults

HEAT_PARAMETERS = {"t_coef": 1.0, "use_robust": True}


def make_heat(V: ArrayLike, F: ArrayLike, **parameters: Any) -> Any:
    """Build a `HeatSolver`; see there for the parameters.

    Raises
    ------
    UsageError
        If a parameter is unknown or out of range.
    InputError
        If the arrays are not those of a mesh.
    """
    values = with_defaults("geodesic heat", HEAT_PARAMETERS, parameters)
    from meshmark_plugins.geodesics.heat import HeatSolver

    return HeatSolver(V, F, **values)


def make_dijkstra(V: ArrayLike, F: ArrayLike, **parameters: Any) -> Any:
    """Build a `DijkstraSolver`, which takes no parameters.

    Raises
    ------
    UsageError
        If a parameter is given.
    InputError
        If the arrays are not those of a mesh.
    """
    with_defaults("geodesic dijkstra", {}, parameters)
    from meshmark_plugins.geodesics.dijkstra import DijkstraSolver

    return DijkstraSolver(V, F)


def make_exact(V: ArrayLike, F: ArrayLike, **parameters: Any) -> Any:
    """Build an `ExactSolver`, which takes no parameters.

    Raises
    ------
    UsageError
        If a parameter is given.
    InputError
        If the arrays are not those of a manifold mesh.
    """
    with_defaults("geodesic exact", {}, parameters)
    from meshmark_plugins.geodesics.exact import ExactSolver

    return ExactSolver(V, F)


@hookimpl
def meshmark_geodesic_solvers() -> list[GeodesicSolverRecord]:
    """Offer the built-in solvers."""
    return [
        GeodesicSolverRecord(
            name="heat",
            factory=make_heat,
            summary="heat method, smooth and fast: about 1 % from exact",
            version="1",
            parameters=HEAT_PARAMETERS,
        ),
        GeodesicSolverRecord(
            name="dijkstra",
            factory=make_dijkstra,
            summary="shortest paths along edges: an upper bound, up to some 10 % too long",
            version="1",
            parameters={},
        ),
        GeodesicSolverRecord(
            name="exact",
            factory=make_exact,
            summary="exact polyhedral distances by window propagation: slow, for reference",
            version="1",
            parameters={},
        ),
    ]
