"""The command that makes a report, put together from the report."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from meshmark.benchmarking.suites import SUITES
from meshmark.errors import UsageError
from meshmark.extension.defaults import DEFAULT_GEODESIC, DEFAULT_SEGMENTER
from meshmark.extension.registry import catalogue

_DEFAULTS = {"segmenter": DEFAULT_SEGMENTER, "geodesic": DEFAULT_GEODESIC}


def command_of(document: Mapping[str, Any]) -> str:
    """Put together the command, with sources by their names alone, and only what is no default."""
    words = ["meshmark", "bench", *(_source(asset) for asset in document["assets"])]
    words += ["--suite", str(document["suite"])]
    if document["informed"]:
        words += ["--informed"]
    recipes = document["schemes"]
    for recipe in recipes:
        words += ["--scheme", recipe["scheme"]["name"]]
    for kind, usual in _DEFAULTS.items():
        if recipes[0][kind]["name"] != usual:
            words += [f"--{kind}", recipes[0][kind]["name"]]
    typed = _before_sharing(recipes) if document["informed"] else recipes
    for setting in dict.fromkeys(text for recipe in typed for text in _settings(recipe)):
        words += ["--set", setting]
    suite = SUITES.get(str(document["suite"]))
    own = set() if suite is None else {cell.label for cell in suite.cells}
    labels = dict.fromkeys(row["label"] for row in document["rows"])
    if not own <= set(labels):
        words += [word for label in labels if label in own for word in ("--row", label)]
    # The labels of rows that are not the suite's are what was typed.
    words += [word for label in labels if label not in own for word in ("--attack", label)]
    if document["frames"] is not None:
        words += ["--frames", document["frames"]]
    words += ["--seed", str(document["seed"]), "-o", "FOLDER"]
    return shlex.join(words)


def _source(asset: Mapping[str, Any]) -> str:
    files = [str(file["file"]) for file in asset["files"]]
    return files[0] if len(files) == 1 else str(asset["asset"])


def _before_sharing(layers: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Give each layer the limit to its distortion that it had before `within_mrms` shared it."""
    limits = [layer["scheme"]["parameters"].get("max_mrms") for layer in layers]
    if None in limits:
        return list(layers)
    factor = math.hypot(*limits) / limits[0]
    return [
        {
            **layer,
            "scheme": {
                **layer["scheme"],
                "parameters": {
                    **layer["scheme"]["parameters"],
                    # Without the last digits, which are rounding errors.
                    "max_mrms": float(f"{factor * limit:.12g}"),
                },
            },
        }
        for layer, limit in zip(layers, limits, strict=True)
    ]


def _settings(recipe: Mapping[str, Any]) -> list[str]:
    found = []
    for kind, plugin in recipe.items():
        try:
            usual = catalogue().find(kind, plugin["name"]).record.parameters
        except UsageError:  # a report of somewhere else, where other plugins are installed
            usual = {}
        found += [
            f"{plugin['name']}.{name}={value}"
            for name, value in plugin["parameters"].items()
            if usual.get(name) != value
        ]
    return found
