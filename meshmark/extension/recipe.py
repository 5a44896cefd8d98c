"""Which scheme, segmenter and solver, with which parameters: from text to working objects."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

from meshmark.arrays import FloatArray, IntArray
from meshmark.errors import UsageError
from meshmark.extension.defaults import (
    DEFAULT_GEODESIC,
    DEFAULT_LAYERS,
    DEFAULT_SCHEME,
    DEFAULT_SEGMENTER,
)
from meshmark.extension.hookspecs import SchemeRecord
from meshmark.extension.interfaces import GeodesicSolver, Segmenter
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

    @property
    def informed(self) -> bool:
        """Whether the scheme reads a copy against its original."""
        return cast(SchemeRecord, catalogue().find("scheme", self.scheme).record).informed

    def parameter(self, name: str) -> Any:
        """Return a parameter of the scheme; None if it has none of that name."""
        defaults = catalogue().find("scheme", self.scheme).record.parameters
        return self.settings.get(self.scheme, {}).get(name, defaults.get(name))

    def with_parameter(self, name: str, value: Any) -> Recipe:
        """Return it with another value of a parameter of the scheme."""
        own = {**self.settings.get(self.scheme, {}), name: value}
        return replace(self, settings={**self.settings, self.scheme: own})

    def build(self) -> Any:
        """Make the `Scheme` or `InformedScheme`, with a segmenter and a solver if it needs them."""
        if self.settings.get(self.segmenter):
            # An impossible value is refused, whether or not the scheme needs a segmenter.
            self.build_segmenter()
        offer = catalogue().find("scheme", self.scheme)
        made = offer.make(**self.build_helpers(), **self.settings.get(self.scheme, {}))
        if self.informed:
            return made
        # It needs most of scipy, for which whoever only names a recipe has no use.
        from meshmark.extension.binned_scheme import as_scheme

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


def layers_from_text(
    schemes: Sequence[str],
    segmenter: str = DEFAULT_SEGMENTER,
    geodesic: str = DEFAULT_GEODESIC,
    settings: Sequence[str] = (),
    *,
    strength: float | None = None,
    max_mrms: float | None = None,
) -> tuple[Recipe, ...]:
    """Build the layers of a mark from what was typed.

    Parameters
    ----------
    settings : sequence of str
        `NAME=VALUE` for the first scheme, or `PLUGIN.NAME=VALUE` for whichever has it.
    strength, max_mrms : float, optional
        Of the first scheme; of all layers together, see `within_mrms`.

    Raises
    ------
    UsageError
        As `recipe_from_text` and `in_order` raise it.
    """
    first, *others = schemes
    theirs = [text for text in settings if text.partition("=")[0].rpartition(".")[0] in others]
    rest = [text for text in settings if text not in theirs]
    alone = {"strength": strength, "max_mrms": None if others else max_mrms}
    layers = [recipe_from_text(first, segmenter, geodesic, rest, alone)]
    for name in others:
        own = [text for text in theirs if text.startswith(f"{name}.")]
        layers.append(recipe_from_text(name, segmenter, geodesic, own))
    if not others:
        return in_order(layers)
    return within_mrms(in_order(layers), max_mrms)


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


def in_order(recipe: Recipe | Sequence[Recipe] | None) -> tuple[Recipe, ...]:
    """List the layers of a mark, blind ones first; `default_layers` for None.

    Raises
    ------
    UsageError
        If there is none, or one scheme twice.
    """
    if recipe is None:
        return default_layers()
    layers = (recipe,) if isinstance(recipe, Recipe) else tuple(recipe)
    names = [layer.scheme for layer in layers]
    if not names or len(set(names)) < len(names):
        raise UsageError("a mark has one or several layers, each by a scheme of its own")
    return tuple(sorted(layers, key=lambda layer: layer.informed))


def default_layers() -> tuple[Recipe, ...]:
    """Return the layers of a mark where nobody says otherwise, within one limit to distortion."""
    return within_mrms([Recipe(name) for name in DEFAULT_LAYERS])


def within_mrms(layers: Sequence[Recipe], max_mrms: float | None = None) -> tuple[Recipe, ...]:
    """Share a limit to the distortion among layers, in proportion to their own.

    Parameters
    ----------
    max_mrms : float, optional
        For all together; by default the first layer's own. Moves of different layers have nothing
        to do with each other, so that the squares sum up.

    Raises
    ------
    UsageError
        If a layer has no such limit, although one is asked for.
    """
    limits = [layer.parameter("max_mrms") for layer in layers]
    total = mrms_limit(layers)
    if total is None:
        if max_mrms is None:
            return tuple(layers)
        name = layers[limits.index(None)].scheme
        raise UsageError(f"scheme {name} has no limit to the distortion")
    share = (limits[0] if max_mrms is None else max_mrms) / total
    return tuple(
        layer.with_parameter("max_mrms", share * limit)
        for layer, limit in zip(layers, limits, strict=True)
    )


def mrms_limit(layers: Sequence[Recipe]) -> float | None:
    """Return what layers may distort together, see `within_mrms`; None if one has no limit."""
    limits = [layer.parameter("max_mrms") for layer in layers]
    return None if None in limits else float(np.sqrt(sum(limit**2 for limit in limits)))


def blind_layers() -> tuple[Recipe, ...]:
    """Return those of them that a copy shows by itself."""
    return tuple(layer for layer in default_layers() if not layer.informed)


def scheme_names() -> tuple[str, ...]:
    """Return the names of all schemes there are, the default first."""
    names = [offer.name for offer in catalogue().of_kind("scheme")]
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_SCHEME, name)))
