"""Blind, robust marks for animated meshes.

Mark on publish, and later say from a leaked copy alone, and a secret key: ours, whose copy,
and with what probability of being wrong.
"""

import sys

# `python -m` puts the working directory first on the import path, and calls the program "-m" while
# it looks for the module. Nothing there is to be imported, `__future__` and `typing` neither.
if sys.argv[:1] == ["-m"] and not sys.flags.safe_path:
    del sys.path[0]

from importlib import import_module
from typing import TYPE_CHECKING, Any

from meshmark.version import __version__

if TYPE_CHECKING:
    from meshmark.detection.verdict import Verdict
    from meshmark.detection.verify import verify
    from meshmark.embedding.asset import MarkedAsset, embed
    from meshmark.embedding.file import mark_file
    from meshmark.embedding.manifest import Manifest
    from meshmark.errors import (
        CapacityError,
        InputError,
        MeshmarkError,
        OutputError,
        PluginError,
        UsageError,
        WorkerError,
    )
    from meshmark.extension.recipe import Recipe
    from meshmark.keys import Key
    from meshmark.mesh.animation import Asset, Frame, MeshAnimation, Topology
    from meshmark.sources.readers import read, write

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

# Where names are, for when they are first asked for: numpy and scipy take half a second to import,
# which those who ask for help or the version should not have to wait for.
_HOMES = {
    "mesh.animation": ("Asset", "Frame", "MeshAnimation", "Topology"),
    "errors": (
        "CapacityError",
        "InputError",
        "MeshmarkError",
        "OutputError",
        "PluginError",
        "UsageError",
        "WorkerError",
    ),
    "keys": ("Key",),
    "embedding.manifest": ("Manifest",),
    "embedding.asset": ("MarkedAsset", "embed"),
    "embedding.file": ("mark_file",),
    "extension.recipe": ("Recipe",),
    "sources.readers": ("read", "write"),
    "detection.verdict": ("Verdict",),
    "detection.verify": ("verify",),
}


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            value = getattr(import_module(f"{__name__}.{module}"), name)
            # From now on found without asking.
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
