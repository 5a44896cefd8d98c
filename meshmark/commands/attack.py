"""Attacks on whole assets, seeded, and their results written as real files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from meshmark.errors import UsageError
from meshmark.extension.interfaces import Attack
from meshmark.extension.parameters import name_and_value
from meshmark.extension.recipe import convert
from meshmark.extension.registry import catalogue, make_attack
from meshmark.files.places import data_file, require_apart
from meshmark.mesh.asset import Asset
from meshmark.sources.facts import files_in_reach
from meshmark.sources.readers import new_writer
from meshmark.usd.names import LAYER_SUFFIXES


def attack_from_text(name: str, parameters: Sequence[str]) -> Attack:
    """Make an attack from its name and typed PARAMETER=VALUE pairs.

    Raises
    ------
    UsageError
        If the attack or a parameter is unknown, or a value impossible.
    """
    offer = catalogue().find("attack", name)
    values: dict[str, Any] = {}
    for text in parameters:
        parameter, value = name_and_value(text, f"-p takes PARAMETER=VALUE, not {text!r}")
        values[parameter] = convert(offer, parameter, value)
    return make_attack(name, **values)


def attack_asset(asset: Asset, attack: Attack, seed: int) -> Asset:
    """Attack every mesh, each with random numbers of its own."""
    streams = np.random.SeedSequence(seed).spawn(len(asset.meshes))
    meshes = tuple(
        attack.apply(mesh, np.random.default_rng(stream))
        for mesh, stream in zip(asset.meshes, streams, strict=True)
    )
    return replace(asset, meshes=meshes)


def write_attacked(asset: Asset, output: Path) -> None:
    """Write an attacked asset whole: a USD stage, a glTF file, or OBJ files, by its name.

    Raises
    ------
    UsageError
        If the output is none of them.
    OutputError
        If it is part of the source.
    """
    require_apart([output, data_file(output, 0)], files_in_reach(asset))
    if output.suffix.lower() in LAYER_SUFFIXES:
        from meshmark.usd.stages import write_stage

        return write_stage(asset, output)
    reader = new_writer(output)
    if reader is None:
        raise UsageError(
            f"an attack's result is one of {', '.join(LAYER_SUFFIXES)}, .glb, .gltf, or a folder "
            "of OBJ frames",
            source=output,
        )
    return reader.write_new(asset, output)
