"""What a layer says about where it comes from and who made it: taken out, except terms of use."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pxr import Sdf, Usd, Vt

from meshmark.usd.layers import set_field, set_value, value_at

TERMS = re.compile(r"copyright|©|\(c\)|licen[cs]|terms[ _-]?of|all rights", re.I)
PERSONAL = re.compile(
    r"author|artist|creator|created.?by|modified.?by|owner|user.?name|(^|[:_])user$|login|"
    r"host.?name|(^|[:_])host$|machine|work.?station|e.?mail|comment|department|studio",
    re.I,
)
TEXTS = ("documentation", "comment")
DICTIONARIES = ("customData", "customLayerData", "assetInfo")
NAMES = ("owner", "sessionOwner")
# What is no metadata, or cannot be asked for.
VALUES = ("default", "timeSamples", "subLayerOffsets")
# Where paths begin: absolute ones of any system, and those that climb.
PATH = re.compile(
    r"""(?<![^\s"'=(\[{<,;@|])"""
    r"""(?:file:/+|[A-Za-z]:[\\/]|\\\\|~[\w-]*/|\$\{?\w+\}?/|(?:\.\.[\\/])+|/(?=[^\s/"']+/))"""
    r"""[^\s"'<>|;,)\]}]+"""
)
WHOLE_PATH = re.compile(r"(?:file:/+|[A-Za-z]:[\\/]|\\\\|~[\w-]*/|(?:\.\.[\\/])+|/[^/\n]+/)[^\n]*")

Tell = Callable[[str], None]


def file_name(path: str) -> str:
    """Return the last part of a path of any system."""
    return re.split(r"[\\/]+", path.rstrip("\\/"))[-1]


def paths_in(text: str, layer: Sdf.Layer) -> list[str]:
    """List the paths in a text that lead to files outside; paths of prims are none of them."""
    if WHOLE_PATH.fullmatch(text):
        return [] if _names_a_prim(text, layer) else [text]
    return [path for path in PATH.findall(text) if not _names_a_prim(path, layer)]


def strip_metadata(layer: Sdf.Layer, stage: Usd.Stage) -> list[str]:
    """Take out of a flattened layer what tells of its origin, and put in its terms of use.

    Documentation, comments, `customData`, `customLayerData` and `assetInfo` go, and properties of
    the user's own that name people or machines; entries that speak of copyright, licences or
    terms of use stay. Of paths to files, in whatever text is left, the file's name stays.

    Parameters
    ----------
    layer : Sdf.Layer
        The flattened layer.
    stage : Usd.Stage
        What it was flattened from; what its layers said as a whole is looked at, too.

    Returns
    -------
    list of str
        Where something was taken out, sorted, and what.
    """
    removed: set[str] = set()
    texts, data = _said_by_layers(stage)
    terms = [text for text in texts if TERMS.search(text)]
    if terms != texts:
        removed.add("/: documentation")
    _say(layer, terms, data)
    for path in paths_of(layer):
        spec = layer.GetObjectAtPath(path)
        if spec is None:
            continue
        if isinstance(spec, Sdf.AttributeSpec) and _is_personal(spec):
            del layer.GetPrimAtPath(path.GetPrimPath()).properties[spec.name]
            removed.add(f"{path}: names a person or machine")
            continue
        for key, value in fields_of(spec):
            _strip_field(spec, key, value, layer, removed.add)
        if isinstance(spec, Sdf.AttributeSpec):
            _strip_values(spec, layer, removed.add)
    return sorted(removed)


def copy_layer_metadata(layer: Sdf.Layer, stage: Usd.Stage) -> None:
    """Put what the layers of a stage say as a whole into a flattened layer."""
    texts, data = _said_by_layers(stage)
    _say(layer, texts, data)


def _say(layer: Sdf.Layer, texts: list[str], data: dict[str, Any]) -> None:
    if texts:
        layer.documentation = "\n".join(texts)
    if data:
        layer.customLayerData = data


def _said_by_layers(stage: Usd.Stage) -> tuple[list[str], dict[str, Any]]:
    """Gather the texts and data of a stage's root layer and its sublayers, the strongest first."""
    texts: dict[str, None] = {}
    data: dict[str, Any] = {}
    for each in stage.GetLayerStack(includeSessionLayers=False):
        # A binary layer can hold values that are not of their field's type.
        said = (each.pseudoRoot.GetInfo(key) for key in TEXTS)
        texts.update((text, None) for text in said if isinstance(text, str) and text)
        own = each.pseudoRoot.GetInfo("customLayerData")
        data = {**(own if isinstance(own, Mapping) else {}), **data}
    return list(texts), data


def paths_of(layer: Sdf.Layer) -> list[Sdf.Path]:
    """List all prims and properties of a layer, the pseudo-root first."""
    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    return sorted(paths)


def fields_of(spec: Sdf.Spec) -> Iterator[tuple[str, Any]]:
    """Yield the metadata of a prim, property or layer: texts, numbers and dictionaries."""
    for key in spec.ListInfoKeys():
        if key not in VALUES:
            yield key, spec.GetInfo(key)


def _strip_field(spec: Sdf.Spec, key: str, value: Any, layer: Sdf.Layer, tell: Tell) -> None:
    where = f"{spec.path}: {key}"
    if key in NAMES or (key in TEXTS and not _speaks_of_terms(value)):
        spec.ClearInfo(key)
        tell(where)
        return
    kept = value
    if key in DICTIONARIES:
        kept = dict(_terms(value, where, tell))
        if not kept:
            spec.ClearInfo(key)
            return
    kept = shortened(kept, layer, where, tell)
    if kept != value:
        set_field(spec, key, kept)


def _terms(data: Any, where: str, tell: Tell) -> Iterator[tuple[str, Any]]:
    """Yield the entries that speak of terms of use, by their key or in their text."""
    if not isinstance(data, Mapping):
        tell(where)
        return
    for key, value in data.items():
        if TERMS.search(key) or _speaks_of_terms(value):
            yield key, value
        elif isinstance(value, Mapping) and (kept := dict(_terms(value, f"{where}:{key}", tell))):
            yield key, kept
        elif not isinstance(value, Mapping) or not value:
            tell(f"{where}:{key}")


def _speaks_of_terms(value: Any) -> bool:
    # A binary layer can hold values that are not of their field's type.
    return isinstance(value, str) and bool(TERMS.search(value))


def shortened(value: Any, layer: Sdf.Layer, where: str, tell: Tell) -> Any:
    """Leave the file's name of every path in a text, a list of texts, or a dictionary."""
    if isinstance(value, str):
        text = str(value)
        for path in paths_in(text, layer):
            text = text.replace(path, file_name(path))
        if text != value:
            tell(f"{where}: a path")
        return text
    if isinstance(value, Vt.StringArray | Vt.TokenArray):
        new = [shortened(text, layer, where, tell) for text in value]
        return type(value)(new) if new != list(value) else value
    if isinstance(value, Mapping):
        items = value.items()
        return {key: shortened(each, layer, f"{where}:{key}", tell) for key, each in items}
    return value


def _strip_values(attribute: Sdf.AttributeSpec, layer: Sdf.Layer, tell: Tell) -> None:
    types = Sdf.ValueTypeNames
    if attribute.typeName not in (types.String, types.StringArray, types.Token, types.TokenArray):
        return
    path = attribute.path
    for time in (math.nan, *layer.ListTimeSamplesForPath(path)):
        value = value_at(layer, path, time)
        new = shortened(value, layer, str(path), tell)
        if new != value:
            set_value(layer, path, time, new)


def _is_personal(attribute: Sdf.AttributeSpec) -> bool:
    own = attribute.custom or attribute.name.startswith("userProperties:")
    texts = (Sdf.ValueTypeNames.String, Sdf.ValueTypeNames.StringArray, Sdf.ValueTypeNames.Token)
    return (
        own
        and attribute.typeName in texts
        and bool(PERSONAL.search(attribute.name.removeprefix("userProperties:")))
        and not TERMS.search(attribute.name)
    )


def _names_a_prim(text: str, layer: Sdf.Layer) -> bool:
    return bool(Sdf.Path.IsValidPathString(text) and layer.GetObjectAtPath(text))
