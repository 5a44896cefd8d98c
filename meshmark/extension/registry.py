"""Finds plugins, keeps broken ones from stopping the tool, and makes what they name."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.metadata import Distribution, EntryPoint, distributions
from typing import Any, cast

import pluggy

from meshmark.errors import MeshmarkError, PluginError, UsageError
from meshmark.extension import hookspecs
from meshmark.extension.hookspecs import PROJECT, Attack, PluginRecord, Reader, Segmenter
from meshmark.extension.parameters import require_known

STRICT_VARIABLE = "MESHMARK_STRICT_PLUGINS"

# Kind as the user types it -> hook, and the record the hook must yield.
KINDS: Mapping[str, tuple[str, type[PluginRecord]]] = {
    "reader": ("meshmark_readers", hookspecs.ReaderRecord),
    "segmenter": ("meshmark_segmenters", hookspecs.SegmenterRecord),
    "geodesic": ("meshmark_geodesic_solvers", hookspecs.GeodesicSolverRecord),
    "scheme": ("meshmark_schemes", hookspecs.SchemeRecord),
    "attack": ("meshmark_attacks", hookspecs.AttackRecord),
}


@dataclass(frozen=True)
class RegisteredPlugin:
    """A record, and the distribution that offers it."""

    kind: str
    record: PluginRecord
    distribution: str
    distribution_version: str

    @property
    def name(self) -> str:
        """What the user types."""
        return self.record.name

    def make(self, *args: Any, **parameters: Any) -> Any:
        """Call the factory.

        Raises
        ------
        UsageError
            If it refuses a value.
        PluginError
            If it breaks.
        """
        try:
            return self.record.factory(*args, **parameters)
        except MeshmarkError:
            raise
        except Exception as error:
            raise PluginError(
                f"{self.kind} {self.name!r} of {self.distribution} failed: {_reason(error)}"
            ) from error


@dataclass(frozen=True)
class Broken:
    """A plugin that could not be used, and why."""

    plugin: str
    distribution: str
    reason: str


@dataclass(frozen=True)
class Catalogue:
    """Everything the installed plugins offer.

    Parameters
    ----------
    offers : tuple of RegisteredPlugin
        In order of kind, then name.
    broken : tuple of Broken
        Plugins that were left out.
    collisions : mapping of (kind, name) to distributions
        Names claimed more than once: an error as soon as one of them is asked for.
    """

    offers: tuple[RegisteredPlugin, ...]
    broken: tuple[Broken, ...] = ()
    collisions: Mapping[tuple[str, str], tuple[str, ...]] = field(default_factory=dict)

    def of_kind(self, kind: str) -> tuple[RegisteredPlugin, ...]:
        """Return the offers of one kind."""
        return tuple(offer for offer in self.offers if offer.kind == kind)

    def find(self, kind: str, name: str) -> RegisteredPlugin:
        """Return the offer of that name.

        Raises
        ------
        UsageError
            If there is none; the message lists those there are.
        PluginError
            If two distributions claim the name.
        """
        claimed = self.collisions.get((kind, name))
        if claimed:
            raise PluginError(
                f"{kind} {name!r} is offered by {' and by '.join(claimed)}; uninstall one of them"
            )
        for offer in self.offers:
            if offer.kind == kind and offer.name == name:
                return offer
        known = ", ".join(offer.name for offer in self.of_kind(kind)) or "none"
        raise UsageError(f"no {kind} is called {name!r}; known are: {known}{self._hint()}")

    def make(self, kind: str, name: str, /, *args: Any, **parameters: Any) -> Any:
        """Call the factory of an offer with parameters its record lists.

        Raises
        ------
        UsageError
            If it takes no such parameter, or refuses its value.
        PluginError
            If it breaks.
        """
        offer = self.find(kind, name)
        check_parameters(offer, parameters)
        return offer.make(*args, **parameters)

    def _hint(self) -> str:
        if not self.broken:
            return ""
        names = ", ".join(f"{item.plugin} ({item.reason})" for item in self.broken)
        return f"; not loaded: {names}"


def check_parameters(offer: RegisteredPlugin, parameters: Mapping[str, Any]) -> None:
    """Refuse parameters the offer's record does not list."""
    require_known(f"{offer.kind} {offer.name!r}", offer.record.parameters, parameters)


@cache
def catalogue() -> Catalogue:
    """Load every plugin of the entry-point group `meshmark`, once a process.

    Raises
    ------
    PluginError
        Only with MESHMARK_STRICT_PLUGINS=1: for the first plugin that is broken.
    """
    return load(list(_entry_points()), strict=os.environ.get(STRICT_VARIABLE) == "1")


def load(found: Sequence[tuple[EntryPoint, Distribution]], *, strict: bool) -> Catalogue:
    """Build a catalogue from entry points; see `catalogue`."""
    manager = pluggy.PluginManager(PROJECT)
    manager.add_hookspecs(hookspecs)
    offers: list[RegisteredPlugin] = []
    broken: list[Broken] = []
    for entry, distribution in found:
        name, version = distribution.metadata["Name"], distribution.version
        try:
            plugin = entry.load()
            manager.register(plugin, name=f"{name}:{entry.name}")
            manager.check_pending()
            records = _records(manager, plugin)
            offers += [RegisteredPlugin(kind, record, name, version) for kind, record in records]
        # A stranger's module may raise anything at all while it is imported.
        except (Exception, SystemExit) as error:
            if strict:
                raise PluginError(
                    f"plugin {entry.name!r} of {name} is broken: {_reason(error)}"
                ) from error
            manager.unregister(name=f"{name}:{entry.name}")
            broken.append(Broken(entry.name, name, _reason(error)))
    return _without_collisions(offers, broken)


def _records(manager: pluggy.PluginManager, plugin: object) -> list[tuple[str, PluginRecord]]:
    records = []
    for kind, (hook, record_type) in KINDS.items():
        implementations = getattr(manager.hook, hook).get_hookimpls()
        for implementation in implementations:
            if implementation.plugin is not plugin:
                continue
            for record in implementation.function():
                if not isinstance(record, record_type):
                    raise PluginError(f"{hook} must yield {record_type.__name__}, not {record!r}")
                records.append((kind, record))
    return records


def _without_collisions(offers: Sequence[RegisteredPlugin], broken: Sequence[Broken]) -> Catalogue:
    claims: dict[tuple[str, str], list[RegisteredPlugin]] = {}
    for offer in offers:
        claims.setdefault((offer.kind, offer.name), []).append(offer)
    order = list(KINDS)
    single = sorted(
        (group[0] for group in claims.values() if len(group) == 1),
        key=lambda offer: (order.index(offer.kind), offer.name),
    )
    collisions = {
        key: tuple(offer.distribution for offer in group)
        for key, group in claims.items()
        if len(group) > 1
    }
    return Catalogue(tuple(single), tuple(broken), collisions)


def _entry_points() -> Iterator[tuple[EntryPoint, Distribution]]:
    # Only of those that offer something: metadata of all that is installed takes long to parse.
    offering = (each.metadata["Name"] for each in distributions() if any(_own(each)))
    for name in dict.fromkeys(filter(None, offering)):
        # The first on the path wins, as it does for imports.
        first = Distribution.from_name(name)
        for entry in _own(first):
            yield entry, first


def _own(found: Distribution) -> Iterator[EntryPoint]:
    return (entry for entry in found.entry_points if entry.group == PROJECT)


def _reason(error: BaseException) -> str:
    text = str(error).strip().splitlines()
    return f"{type(error).__name__}: {text[0]}" if text else type(error).__name__


def make_reader(name: str, /, **parameters: Any) -> Reader:
    """Make the reader of that name."""
    return cast(Reader, catalogue().make("reader", name, **parameters))


def make_segmenter(name: str, /, **parameters: Any) -> Segmenter:
    """Make the segmenter of that name."""
    return cast(Segmenter, catalogue().make("segmenter", name, **parameters))


def make_attack(name: str, /, **parameters: Any) -> Attack:
    """Make the attack of that name."""
    return cast(Attack, catalogue().make("attack", name, **parameters))
