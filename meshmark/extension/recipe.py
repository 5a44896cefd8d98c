"""Which scheme, segmenter and solver, with which parameters: from text to working objects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, cast

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import UsageError
from meshmark.extension.binned_scheme import as_scheme
from meshmark.extension.defaults import DEFAULT_GEODESIC, DEFAULT_SCHEME, DEFAULT_SEGMENTER
from meshmark.extension.hookspecs import SchemeRecord
from meshmark.extension.interfaces import GeodesicSolver, Scheme, Segmenter
from meshmark.extension.parameters import name_and_value
from meshmark.extension.registry import (
    RegisteredPlugin,
    catalogue,
    check_parameters,
    make_segmenter,
)

Parameters = Mapping[str, Any]


@dataclass(frozen=True)
class SolverFactory:
    """Builds geodesic solvers of one kind; pickles as its name and parameters."""

    name: str
    parameters: Parameters

    def __call__(self, V: FloatArray, F: IntArray) -> GeodesicSolver:
        """Build a solver on V (N, 3) and F (F, 3)."""
        return cast(
            GeodesicSolver, catalogue().make("geodesic", self.name, V, F, **self.parameters)
        )


@dataclass(frozen=True)
class Recipe:
    """A scheme and what it works with.

    Parameters
    ----------
    scheme, segmenter, geodesic : str
        Names of plugins.
    settings : mapping of str to mapping
        Parameters that differ from the defaults, by plugin name.

    Raises
    ------
    UsageError
        If a name is unknown, or a parameter is not one of its plugin's.
    """

    scheme: str = DEFAULT_SCHEME
    segmenter: str = DEFAULT_SEGMENTER
    geodesic: str = DEFAULT_GEODESIC
    settings: Mapping[str, Parameters] = field(default_factory=dict)

    def __post_init__(self) -> None:
        offers = {offer.name: offer for offer in self.offers}
        for name, parameters in self.settings.items():
            if name not in offers:
                raise UsageError(
                    f"parameters are given for {name!r}, but only {', '.join(offers)} are in use"
                )
            check_parameters(offers[name], parameters)

    @property
    def offers(self) -> tuple[RegisteredPlugin, RegisteredPlugin, RegisteredPlugin]:
        """The plugins behind the names: scheme, segmenter, solver."""
        plugins = catalogue()
        return (
            plugins.find("scheme", self.scheme),
            plugins.find("segmenter", self.segmenter),
            plugins.find("geodesic", self.geodesic),
        )

    def build(self) -> Scheme:
        """Make the scheme, with the segmenter and the solver if it needs them."""
        if self.settings.get(self.segmenter):
            # An impossible value is refused, whether or not the scheme needs a segmenter.
            self.build_segmenter()
        offer = catalogue().find("scheme", self.scheme)
        made = offer.make(**self.build_helpers(), **self.settings.get(self.scheme, {}))
        return as_scheme(made)

    def build_helpers(self) -> dict[str, Any]:
        """Make what the scheme's record says that its factory needs."""
        builders = {"segmenter": self.build_segmenter, "solver": self.build_solver}
        record = cast(SchemeRecord, catalogue().find("scheme", self.scheme).record)
        return {name: builders[name]() for name in record.needs}

    def build_segmenter(self) -> Segmenter:
        """Make the segmenter alone."""
        return make_segmenter(self.segmenter, **self.settings.get(self.segmenter, {}))

    def build_solver(self) -> Callable[[FloatArray, IntArray], GeodesicSolver]:
        """Make what builds geodesic solvers on meshes (V, F)."""
        return SolverFactory(self.geodesic, dict(self.settings.get(self.geodesic, {})))

    def as_json(self) -> dict[str, Any]:
        """Return plugins, versions and all parameters, for the manifest."""
        return {
            offer.kind: {
                "name": offer.name,
                "version": offer.record.version,
                "distribution": offer.distribution,
                "distribution_version": offer.distribution_version,
                "parameters": {
                    **offer.record.parameters,
                    **self.settings.get(offer.name, {}),
                },
            }
            for offer in self.offers
        }


def recipe_from_text(
    scheme: str,
    segmenter: str = DEFAULT_SEGMENTER,
    geodesic: str = DEFAULT_GEODESIC,
    settings: Sequence[str] = (),
    own: Mapping[str, float | None] | None = None,
) -> Recipe:
    """Build a recipe from what was typed: `bits=16` is the scheme's, `sdf.rays=25` sdf's.

    Parameters
    ----------
    own : mapping of str to float or None, optional
        Parameters of the scheme that have flags of their own; None where the flag is not given.

    Raises
    ------
    UsageError
        If a setting is not NAME=VALUE, or its value is not of its default's type.
    """
    typed: dict[str, dict[str, Any]] = {}
    for text in settings:
        refusal = f"--set takes NAME=VALUE, not {text!r}"
        name, value = name_and_value(text, refusal)
        if not name:
            raise UsageError(refusal)
        plugin, dot, parameter = name.rpartition(".")
        typed.setdefault(plugin if dot else scheme, {})[parameter] = value
    bare = Recipe(scheme, segmenter, geodesic, typed)
    offers = {offer.name: offer for offer in bare.offers}
    converted = {
        plugin: {name: convert(offers[plugin], name, value) for name, value in given.items()}
        for plugin, given in typed.items()
    }
    for name, number in (own or {}).items():
        if number is not None:
            converted.setdefault(scheme, {})[name] = number
    return Recipe(scheme, segmenter, geodesic, converted)


def convert(offer: RegisteredPlugin, name: str, text: str) -> Any:
    """Turn typed text into a value of the type of the parameter's default."""
    default = offer.record.parameters.get(name)
    try:
        if isinstance(default, bool):
            return {"true": True, "1": True, "false": False, "0": False}[text.lower()]
        if isinstance(default, int):
            return int(text)
        if isinstance(default, float):
            return float(text)
    except (ValueError, KeyError):
        kind = type(default).__name__
        raise UsageError(
            f"{offer.kind} {offer.name!r}: {name} takes a value like {default!r} ({kind}), "
            f"not {text!r}"
        ) from None
    return text


def all_schemes() -> tuple[Recipe, ...]:
    """Return a recipe for each scheme there is, with its default parameters."""
    return tuple(Recipe(name, DEFAULT_SEGMENTER, DEFAULT_GEODESIC) for name in scheme_names())


def scheme_names() -> tuple[str, ...]:
    """Return the names of all schemes there are, the default first."""
    names = [offer.name for offer in catalogue().of_kind("scheme")]
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_SCHEME, name)))
