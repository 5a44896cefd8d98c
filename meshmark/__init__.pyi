from .detection.verdict import Verdict
from .detection.verify import verify
from .embedding.asset import MarkedAsset, embed
from .embedding.file import mark_file
from .embedding.manifest import Manifest
from .errors import (
    CapacityError,
    InputError,
    MeshmarkError,
    OutputError,
    PluginError,
    UsageError,
    WorkerError,
)
from .extension.recipe import Recipe
from .keys import Key
from .mesh.animation import Frame, MeshAnimation
from .mesh.asset import Asset
from .mesh.topology import Topology
from .sources.reading import read
from .sources.writing import write
from .version import __version__

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
