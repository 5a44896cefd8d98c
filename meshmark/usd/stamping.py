"""Stamps: the schema `MeshmarkAPI` on marked prims, which says so to whoever reads the stage."""

from __future__ import annotations

import re
from collections.abc import Collection

from pxr import Sdf, Usd

from meshmark.usd.metadata import paths_of
from meshmark.usd.stamp import Stamp

API = "MeshmarkAPI"
NAMESPACE = "meshmark:"
RECORD, SCHEMES = f"{NAMESPACE}record", f"{NAMESPACE}schemes"
SCHEMAS = "apiSchemas"
# What may be printed of what a stranger wrote.
_RECORD = re.compile(r"[0-9a-f]{32}")
_SCHEME = re.compile(r"[\w.-]{1,64}")
# All that a stamp's attributes have.
_FIELDS = {"custom", "default", "typeName", "variability"}


def write_stamp(prim: Sdf.PrimSpec, stamp: Stamp) -> None:
    """Apply the schema to a prim in a layer; whatever else is applied to it there stays."""
    schemas = prim.GetInfo(SCHEMAS) if prim.HasInfo(SCHEMAS) else Sdf.TokenListOp()
    schemas.prependedItems = [*schemas.prependedItems, API]
    prim.SetInfo(SCHEMAS, schemas)
    types, uniform = Sdf.ValueTypeNames, Sdf.VariabilityUniform
    Sdf.AttributeSpec(prim, RECORD, types.String, uniform).default = stamp.record
    Sdf.AttributeSpec(prim, SCHEMES, types.TokenArray, uniform).default = list(stamp.schemes)


def is_stamped(prim: Usd.Prim) -> bool:
    """Tell whether a prim has a stamp, of whatever kind; USD need not know the schema."""
    schemas = prim.GetMetadata(SCHEMAS)
    return isinstance(schemas, Sdf.TokenListOp) and API in schemas.GetAddedOrExplicitItems()


def stamp_note(prim: Usd.Prim) -> str | None:
    """Say what the stamp of a prim says, if it has one."""
    if not is_stamped(prim):
        return None
    found = _stamp(prim.GetAttribute(RECORD).Get(), prim.GetAttribute(SCHEMES).Get())
    if found is None:
        return "stamped, by something else than meshmark"
    return f"stamped: marked by {', '.join(found.schemes)}, record {found.record}"


def remove_stamps(layer: Sdf.Layer, kept: Collection[Stamp]) -> list[str]:
    """Take stamps off the prims of a layer, except those that say what is in `kept` and no more.

    Returns
    -------
    list of str
        Where there was one, and what it gave away.
    """
    removed: list[str] = []
    for path in paths_of(layer):
        spec = layer.GetObjectAtPath(path)
        if not isinstance(spec, Sdf.PrimSpec) or path == Sdf.Path.absoluteRootPath:
            continue
        schemas = spec.GetInfo(SCHEMAS)
        named = isinstance(schemas, Sdf.TokenListOp) and schemas.HasItem(API)
        own = [each.name for each in spec.properties if each.name.startswith(NAMESPACE)]
        if not (named or own) or (named and _authored(spec, own) in kept):
            continue
        for name in own:
            del spec.properties[name]
        if named:
            _take_off(spec, schemas)
        removed.append(f"{path}: says that it is marked")
    return removed


def _authored(spec: Sdf.PrimSpec, own: list[str]) -> Stamp | None:
    """Return what is authored, if it is a stamp and nothing but one."""
    if set(own) != {RECORD, SCHEMES}:
        return None
    attributes = [spec.attributes.get(name) for name in (RECORD, SCHEMES)]
    if any(each is None or set(each.ListInfoKeys()) - _FIELDS for each in attributes):
        return None
    return _stamp(*(each.default for each in attributes))


def _stamp(record: object, schemes: object) -> Stamp | None:
    if not isinstance(record, str) or not _RECORD.fullmatch(record):
        return None
    try:
        names = tuple(map(str, schemes))  # type: ignore[call-overload]
    except TypeError:
        return None
    return Stamp(record, names) if all(map(_SCHEME.fullmatch, names)) else None


def _take_off(spec: Sdf.PrimSpec, schemas: Sdf.TokenListOp) -> None:
    kinds = ("explicit", "prepended", "appended", "added", "deleted", "ordered")
    left = False
    for name in (f"{kind}Items" for kind in kinds):
        before = list(getattr(schemas, name))
        if API in before:
            setattr(schemas, name, [each for each in before if each != API])
        left |= bool(getattr(schemas, name))
    if left:
        spec.SetInfo(SCHEMAS, schemas)
    else:
        spec.ClearInfo(SCHEMAS)
