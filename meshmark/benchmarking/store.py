"""Results on disk: one JSON file each, named by a hash of everything that determines it."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import meshmark
from meshmark.errors import OutputError
from meshmark.extension.registry import RegisteredPlugin
from meshmark.files.atomic import write_json

FORMAT = 1
# Parts of the package on which no result depends.
_APART = ("benchmarking", "cli", "demo", "testing")


def identity_hash(identity: Mapping[str, Any]) -> str:
    """Hash a JSON document, whatever the order of its keys."""
    text = json.dumps(identity, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


class Store:
    """A folder of results.

    Parameters
    ----------
    folder : Path
        Made if missing.

    Raises
    ------
    OutputError
        If it cannot be made.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"cannot be made: {error.strerror}", source=folder) from None

    def path(self, identity: Mapping[str, Any]) -> Path:
        """Return the file of a result."""
        return self.folder / f"{identity_hash(identity)[:32]}.json"

    def load(self, identity: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return a result, or None if it is not there or cannot be read."""
        try:
            document = json.loads(self.path(identity).read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return document if isinstance(document, dict) else None

    def finished(self, identity: Mapping[str, Any]) -> bool:
        """Tell whether a result is there and no failure: the reason for one may have gone."""
        found = self.load(identity)
        return found is not None and "error" not in found

    def save(self, identity: Mapping[str, Any], result: Mapping[str, Any]) -> None:
        """Write a result in one step."""
        write_json({"identity": dict(identity), **result}, self.path(identity))


def code_hash(offers: Iterable[RegisteredPlugin]) -> str:
    """Hash the code of meshmark and of the packages that offer what a benchmark uses.

    A version number stays the same while code is being worked on; results must not.
    """
    names = {"meshmark", *(_package(offer) for offer in offers)}
    return identity_hash({name: _package_hash(name) for name in sorted(names)})


def _package(offer: RegisteredPlugin) -> str:
    module = getattr(offer.record.factory, "__module__", None) or "meshmark"
    return str(module).partition(".")[0]


@cache
def _package_hash(name: str) -> str:
    """Hash the Python files of an imported package, or of a module of one file."""
    module = meshmark if name == "meshmark" else sys.modules.get(name)
    digest = hashlib.sha256()
    if module is None:
        return digest.hexdigest()
    if not hasattr(module, "__path__"):
        digest.update(Path(str(module.__file__)).read_bytes())
        return digest.hexdigest()
    for root in map(Path, module.__path__):
        for file in sorted(root.rglob("*.py")):
            place = file.relative_to(root)
            if name != "meshmark" or place.parts[0] not in _APART:
                digest.update(place.as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
