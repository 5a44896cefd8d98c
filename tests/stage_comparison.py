"""Two stages compared by what they show: every prim, property and piece of metadata."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from meshmark.usd.instances import NAME

# What hangs on points that were moved.
MOVED = frozenset(
    {"points", "extent", "normals", "velocities", "accelerations", "primvars:normals"}
)
EVERYTHING = Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)
# A root layer's notes on itself, which USD shows as if they were the stage's.
OF_THE_LAYER = frozenset({"customLayerData", "documentation", "comment"})


def differences(
    before: Usd.Stage, after: Usd.Stage, allowed: Mapping[str, Collection[str]]
) -> list[str]:
    """List where two stages differ, other than in what is allowed.

    All prims are compared, with those of classes, overs and inside instances; which instances
    share a prototype; of each prim and property all metadata; of attributes the sample times and
    the value at every one of them, between them and at no time; the targets of relationships.

    Parameters
    ----------
    allowed : mapping of str to collection of str
        By the path of a prim, names of properties and metadata that may differ.
    """
    found: list[str] = []
    theirs, ours = _prims(before), _prims(after)
    # Classes that instances inherit marked points from are new, and nothing that a stage shows.
    ours = {path: prim for path, prim in ours.items() if path in theirs or not _of_class(prim)}
    if list(theirs) != list(ours):
        found.append(f"prims: {sorted(theirs.keys() ^ ours.keys()) or 'another order'}")
    if _sharing(theirs) != _sharing(ours):
        found.append("other instances share a prototype")
    for path in theirs.keys() & ours.keys():
        differing = set(_prim(theirs[path], ours[path])) - set(allowed.get(path, ()))
        found += (f"{path} {name}" for name in differing)
    return sorted(found)


def _prims(stage: Usd.Stage) -> dict[str, Usd.Prim]:
    return {str(prim.GetPath()): prim for prim in Usd.PrimRange(stage.GetPseudoRoot(), EVERYTHING)}


def _of_class(prim: Usd.Prim) -> bool:
    """Tell whether a prim is in a class that an override layer made."""
    return prim.IsAbstract() and prim.GetPath().GetPrefixes()[0].name.startswith(NAME)


def _sharing(prims: Mapping[str, Usd.Prim]) -> list[list[str]]:
    """List the instances of each prototype, whose own name may be any."""
    by_prototype: dict[str, list[str]] = {}
    for path, prim in prims.items():
        if prim.IsInstance():
            by_prototype.setdefault(str(prim.GetPrototype().GetPath()), []).append(path)
    return sorted(by_prototype.values())


def _prim(before: Usd.Prim, after: Usd.Prim) -> Iterator[str]:
    """Yield the names of the metadata and properties that differ."""
    skipped = OF_THE_LAYER if before.IsPseudoRoot() else frozenset()
    for name in _differing(_metadata(before), _metadata(after)):
        if name not in skipped:
            yield name
    own, other = _properties(before), _properties(after)
    for name in own.keys() | other.keys():
        if name not in own or name not in other or not _same_property(own[name], other[name]):
            yield name


def _properties(prim: Usd.Prim) -> dict[str, Usd.Property]:
    return {each.GetName(): each for each in prim.GetProperties()}


def _metadata(prim: Usd.Prim) -> dict[str, Any]:
    image = {"active": prim.IsActive(), "loaded": prim.IsLoaded(), "instance": prim.IsInstance()}
    return {**prim.GetAllMetadata(), **image, "specifier": prim.GetSpecifier()}


def _differing(before: Mapping[str, Any], after: Mapping[str, Any]) -> Iterator[str]:
    for name in before.keys() | after.keys():
        if before.get(name) != after.get(name):
            yield name


def _same_property(before: Usd.Property, after: Usd.Property) -> bool:
    if any(_differing(_property_metadata(before), _property_metadata(after))):
        return False
    if isinstance(before, Usd.Relationship):
        return bool(before.GetTargets() == after.GetTargets())
    times = before.GetTimeSamples()
    if times != after.GetTimeSamples() or before.GetConnections() != after.GetConnections():
        return False
    between = [(a + b) / 2 for a, b in pairwise(times)]
    codes = [Usd.TimeCode.Default(), Usd.TimeCode.EarliestTime(), *times, *between]
    return all(_same_value(before.Get(code), after.Get(code)) for code in codes)


def _property_metadata(each: Usd.Property) -> dict[str, Any]:
    # The value itself is compared with its times.
    return {k: v for k, v in each.GetAllMetadata().items() if k not in ("default", "timeSamples")}


def _same_value(before: Any, after: Any) -> bool:
    if isinstance(before, Sdf.AssetPath):
        return bool(before.resolvedPath == after.resolvedPath and before.path == after.path)
    if type(before) is not type(after):
        return False
    if hasattr(before, "__len__") and not isinstance(before, str):
        return len(before) == len(after) and bool(np.array_equal(before, after))
    return bool(before == after)
