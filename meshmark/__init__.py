"""Blind, robust marks for animated meshes.

Mark on publish, and later say from a leaked copy alone, and a secret key: ours, whose copy,
and with what probability of being wrong.
"""

from __future__ import annotations

from meshmark.animation import Asset, Frame, MeshAnimation, Topology
from meshmark.errors import (
    CapacityError,
    InputError,
    MeshmarkError,
    OutputError,
    PluginError,
    UsageError,
    WorkerError,
)
from meshmark.keys import Key
from meshmark.manifest import Manifest
from meshmark.marking import MarkedAsset, embed
from meshmark.publishing import mark_file
from meshmark.recipe import Recipe
from meshmark.sources import read, write
from meshmark.verdict import Verdict
from meshmark.verification import verify
from meshmark.version import __version__

__all__ = [
    "Asset",
    "CapacityError",
    "Frame",
    "InputError",
    "Key",
    "Manifest",
    "MarkedAsset",
    "MeshAnimation",
    "MeshmarkError",
    "OutputError",
    "PluginError",
    "Recipe",
    "Topology",
    "UsageError",
    "Verdict",
    "WorkerError",
    "__version__",
    "embed",
    "mark_file",
    "read",
    "verify",
    "write",
]
