from __future__ import annotations

import sys
import types
from importlib.metadata import EntryPoint

import pytest

from meshmark.errors import PluginError, UsageError
from meshmark.extension.hookspecs import AttackRecord, SegmenterRecord, hookimpl
from meshmark.extension.registry import catalogue, load


class FakeDistribution:
    def __init__(self, name: str) -> None:
        self.metadata = {"Name": name}
        self.version = "1.2"


@pytest.fixture
def install(monkeypatch):
    """Make importable modules, and the entry points that name them."""

    def make(name: str, **contents):
        module = types.ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
        return EntryPoint(name, name, "meshmark"), FakeDistribution(f"dist-{name}")

    return make


def segmenters(*records):
    @hookimpl
    def meshmark_segmenters():
        return records

    return meshmark_segmenters


def record(name: str, factory=lambda: "made") -> SegmenterRecord:
    return SegmenterRecord(name, factory, "a test", "1", {"size": 3})


def test_built_ins_come_through_their_entry_points() -> None:
    found = catalogue()
    assert not found.broken
    assert not found.collisions
    for kind, name in [
        ("scheme", "tsai2014"),
        ("segmenter", "sdf"),
        ("geodesic", "heat"),
        ("geodesic", "dijkstra"),
        ("geodesic", "exact"),
        ("reader", "obj"),
        ("attack", "noise"),
    ]:
        assert found.find(kind, name).distribution == "meshmark"


def test_a_broken_plugin_is_reported_and_the_rest_works(install) -> None:
    good = install("good_plugin", meshmark_segmenters=segmenters(record("good")))
    entry = EntryPoint("bad_plugin", "no_such_module_at_all", "meshmark")
    found = load([(entry, FakeDistribution("dist-bad")), good], strict=False)
    assert found.make("segmenter", "good") == "made"
    [broken] = found.broken
    assert (broken.plugin, broken.distribution) == ("bad_plugin", "dist-bad")
    assert "no_such_module_at_all" in broken.reason
    with pytest.raises(UsageError, match=r"not loaded: bad_plugin \(ModuleNotFoundError"):
        found.find("segmenter", "missing")


def test_strict_raises_for_a_broken_plugin(install) -> None:
    entry = EntryPoint("bad_plugin", "no_such_module_at_all", "meshmark")
    with pytest.raises(PluginError, match="bad_plugin"):
        load([(entry, FakeDistribution("dist-bad"))], strict=True)


@pytest.mark.parametrize(
    "yielded", [("sdf",), (AttackRecord("a", lambda: 0, "wrong kind", "1", {}),), None]
)
def test_a_hook_that_breaks_its_contract_is_broken(install, yielded) -> None:
    @hookimpl
    def meshmark_segmenters():
        return yielded

    found = load([install("odd_plugin", meshmark_segmenters=meshmark_segmenters)], strict=False)
    assert [item.plugin for item in found.broken] == ["odd_plugin"]
    assert not found.offers


def test_an_unknown_hook_is_broken(install) -> None:
    @hookimpl
    def meshmark_sandwiches():
        return []

    found = load([install("odd_plugin", meshmark_sandwiches=meshmark_sandwiches)], strict=False)
    assert "meshmark_sandwiches" in found.broken[0].reason


def test_importing_the_specs_into_a_module_makes_no_hooks(install) -> None:
    from meshmark.extension import hookspecs

    module = {name: getattr(hookspecs, name) for name in dir(hookspecs) if "meshmark_" in name}
    found = load([install("star_import", **module)], strict=False)
    assert (found.offers, found.broken) == ((), ())


def test_a_name_claimed_twice_names_both_distributions(install) -> None:
    one = install("one", meshmark_segmenters=segmenters(record("same"), record("own")))
    two = install("two", meshmark_segmenters=segmenters(record("same")))
    found = load([one, two], strict=False)
    with pytest.raises(PluginError, match="dist-one and by dist-two"):
        found.find("segmenter", "same")
    assert found.make("segmenter", "own") == "made"


def test_factories_are_called_only_when_used_and_their_failures_named(install) -> None:
    def explode(size: int = 3):
        raise ZeroDivisionError("inside")

    found = load(
        [install("boom", meshmark_segmenters=segmenters(record("boom", explode)))], strict=False
    )
    assert not found.broken
    with pytest.raises(PluginError, match=r"'boom' of dist-boom failed: ZeroDivisionError: inside"):
        found.make("segmenter", "boom")


def test_unlisted_parameters_are_refused(install) -> None:
    found = load([install("good", meshmark_segmenters=segmenters(record("good")))], strict=False)
    with pytest.raises(UsageError, match="no parameter 'colour'; it takes: size"):
        found.make("segmenter", "good", colour="red")
