"""The hooks a plugin implements, and the records and interfaces they speak of.

Each hook yields small frozen records. A record names something and holds a factory, which is
called only when that something is used, so that a heavy import inside it costs nothing before.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import pluggy

from meshmark.extension.interfaces import (
    Attack,
    BinnedScheme,
    GeodesicSolver,
    Reader,
    Scheme,
    Segmenter,
)

__all__ = [
    "HELPERS",
    "PROJECT",
    "Attack",
    "AttackRecord",
    "BinnedScheme",
    "Factory",
    "GeodesicSolver",
    "GeodesicSolverRecord",
    "PluginRecord",
    "Reader",
    "ReaderRecord",
    "Scheme",
    "SchemeRecord",
    "Segmenter",
    "SegmenterRecord",
    "hookimpl",
    "hookspec",
    "meshmark_attacks",
    "meshmark_geodesic_solvers",
    "meshmark_readers",
    "meshmark_schemes",
    "meshmark_segmenters",
]

PROJECT = "meshmark"
hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)

# What the factory of a scheme may ask for.
HELPERS = ("segmenter", "solver")


class Factory(Protocol):
    """Makes what a record names, from parameters given as keywords."""

    def __call__(self, *args: Any, **parameters: Any) -> Any:
        """Build it; raise UsageError for an unknown or impossible parameter."""
        ...


@dataclass(frozen=True)
class PluginRecord:
    """A named thing a plugin offers.

    Parameters
    ----------
    name : str
        What the user types; lower case letters, digits and dashes.
    factory : callable
        Called with the parameters as keywords (a geodesic solver: V, F first). Import what is
        heavy inside it.
    summary : str
        One line for `meshmark plugins list`.
    version : str
        Of the algorithm; recorded in every manifest.
    parameters : mapping of str to object
        Defaults of the parameters the factory takes.
    """

    name: str
    factory: Factory
    summary: str
    version: str
    parameters: Mapping[str, Any]


class ReaderRecord(PluginRecord):
    """Offers a `Reader`."""


class SegmenterRecord(PluginRecord):
    """Offers a `Segmenter`."""


class GeodesicSolverRecord(PluginRecord):
    """Offers a `GeodesicSolver`; the factory takes `V` (N, 3) and `F` (F, 3) first."""


@dataclass(frozen=True)
class SchemeRecord(PluginRecord):
    """Offers a `Scheme`, a `BinnedScheme` or an `InformedScheme`.

    Parameters
    ----------
    needs : tuple of str
        Which of `HELPERS` the factory takes as keywords, beside its parameters: `segmenter`, a
        `Segmenter`, and `solver`, a callable (V, F) -> `GeodesicSolver`.
    informed : bool
        Whether it is an `InformedScheme`, which reads a copy against its original.
    """

    needs: tuple[str, ...] = HELPERS
    informed: bool = False


class AttackRecord(PluginRecord):
    """Offers an `Attack`."""


@hookspec
def meshmark_readers() -> Iterable[ReaderRecord]:  # type: ignore[empty-body]
    """Offer readers of further kinds of files.

    The factory may take parameters of how a source is read. Those called `clip`, a text, and `fps`,
    a number, get what `--clip` and `--fps` say; without these options they have their defaults.

    A reader's `read` gives an `Asset` whose frames are in world space, float64, read lazily
    where that helps. A source that cannot be read raises `InputError` naming file and frame.

    Examples
    --------
    >>> from meshmark.extension.hookspecs import ReaderRecord, hookimpl
    >>> def off_reader():
    ...     from my_package.off import OffReader
    ...     return OffReader()
    >>> @hookimpl
    ... def meshmark_readers():
    ...     return [ReaderRecord("off", off_reader, "Object File Format", "1", {})]
    """


@hookspec
def meshmark_segmenters() -> Iterable[SegmenterRecord]:  # type: ignore[empty-body]
    """Offer segmenters; the factory takes its parameters and makes a `Segmenter`.

    A segmenter maps points (N, 3) float64 and triangles (F, 3) int to labels (F,) int. It is
    deterministic, equal under similarity transforms and re-ordering, and every part is
    edge-connected. `meshmark.testing.SegmenterSuite` checks all of it.

    Examples
    --------
    >>> import numpy as np
    >>> from meshmark.extension.hookspecs import SegmenterRecord, hookimpl
    >>> from meshmark.mesh.topology import face_components
    >>> class Components:
    ...     def segment(self, V, F):
    ...         return face_components(F)
    >>> @hookimpl
    ... def meshmark_segmenters():
    ...     return [SegmenterRecord("components", Components, "one part a component", "1", {})]
    """


@hookspec
def meshmark_geodesic_solvers() -> Iterable[GeodesicSolverRecord]:  # type: ignore[empty-body]
    """Offer geodesic solvers; the factory takes V (N, 3), F (F, 3) and its parameters.

    A solver is built once on a mesh and answers `distances(sources) -> (len(sources), N)`.
    `meshmark.testing.GeodesicSolverSuite` checks it against distances known exactly.

    Examples
    --------
    >>> import numpy as np
    >>> from meshmark.extension.hookspecs import GeodesicSolverRecord, hookimpl
    >>> class Straight:
    ...     def __init__(self, V, F):
    ...         self.V = V
    ...     def distances(self, sources):
    ...         return np.linalg.norm(self.V[sources][:, None] - self.V, axis=2)
    >>> @hookimpl
    ... def meshmark_geodesic_solvers():
    ...     return [GeodesicSolverRecord("straight", Straight, "right on convex ends", "1", {})]
    """


@hookspec
def meshmark_schemes() -> Iterable[SchemeRecord]:  # type: ignore[empty-body]
    """Offer watermarking schemes; the factory makes a `Scheme` or a `BinnedScheme`.

    Beside its own parameters the factory takes the keywords that the record says it needs, by
    default `segmenter`, a `Segmenter`, and `solver`, a callable (V, F) -> `GeodesicSolver`. A
    binned scheme says where the carriers are and how vertices move; measuring, targets and the
    closed loop are the core's. Any other scheme observes each frame by itself, and plans the
    marking of all frames at once. Statistics are the core's for both.
    `meshmark.testing.SchemeSuite` and `BinnedSchemeSuite` check them.

    Examples
    --------
    >>> from meshmark.extension.hookspecs import SchemeRecord, hookimpl
    >>> def my_scheme(*, segmenter, solver, bits=16, strength=0.05):
    ...     from my_package.scheme import MyScheme
    ...     return MyScheme(segmenter, solver, bits, strength)
    >>> @hookimpl
    ... def meshmark_schemes():
    ...     defaults = {"bits": 16, "strength": 0.05}
    ...     return [SchemeRecord("my-scheme", my_scheme, "rings about tips", "1", defaults)]
    """


@hookspec
def meshmark_attacks() -> Iterable[AttackRecord]:  # type: ignore[empty-body]
    """Offer attacks; the factory takes its parameters and makes an `Attack`.

    An attack maps a `MeshAnimation` and a seeded numpy Generator to another `MeshAnimation`.
    `meshmark.testing.AttackSuite` checks determinism and that the input is left alone.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> from meshmark.extension.hookspecs import AttackRecord, hookimpl
    >>> @dataclass(frozen=True)
    ... class Mirror:
    ...     def apply(self, animation, rng):
    ...         return animation.map(flip_x)
    >>> def flip_x(frame):
    ...     return frame.moved(frame.points * [-1, 1, 1])
    >>> @hookimpl
    ... def meshmark_attacks():
    ...     return [AttackRecord("mirror", Mirror, "mirrored in x", "1", {})]
    """
