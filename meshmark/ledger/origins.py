"""What copies were made of, as the ledger tells: one version of one asset, and who got a copy."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from meshmark.ledger.chain import canonical
from meshmark.ledger.marks import MARK

# Paths of Windows: C:\shots, \\server\shots. They may be read elsewhere.
WINDOWS = re.compile(r"[A-Za-z]:|[\\/]{2}")


@dataclass(frozen=True)
class Origin:
    """A source that was marked by one key in the same layers, once or for many recipients.

    Parameters
    ----------
    asset, version : str
        What the ledger calls it.
    key_id : str
    source : Path
        Where it was when the last copy was made.
    digests : tuple of str
        SHA-256 of its files.
    parameters : mapping
        What its reader was told.
    plugins, layers
        As the manifest has them.
    meshes : tuple of (int, int)
        Points and faces of each mesh that was marked.
    copies : tuple of (int, str or None)
        Sequence and recipient of every copy.
    master : mapping or None
        Where the last master was kept, and its hashes.
    """

    asset: str
    version: str
    key_id: str
    source: Path
    digests: tuple[str, ...]
    parameters: Mapping[str, Any]
    plugins: Mapping[str, Any]
    layers: tuple[Mapping[str, Any], ...]
    meshes: tuple[tuple[int, int], ...]
    copies: tuple[tuple[int, str | None], ...]
    master: Mapping[str, Any] | None

    @property
    def names(self) -> tuple[str, ...]:
        """Recipients, each once."""
        return tuple(dict.fromkeys(name for _, name in self.copies if name is not None))

    @property
    def hypotheses(self) -> int:
        """How many words are tried beside it: the owner's, and those of the recipients."""
        return 1 + len(self.names)

    def entries_for(self, recipient: str | None) -> list[int]:
        """List the entries of copies that were made for somebody; None for nobody by name."""
        return [sequence for sequence, name in self.copies if name == recipient]


def origins(entries: Iterable[Mapping[str, Any]]) -> list[Origin]:
    """Gather the copies in a ledger by what they were made of, in order.

    Only the last manifest of each is kept: a ledger may be larger than memory.
    """
    last: dict[str, Mapping[str, Any]] = {}
    copies: dict[str, list[tuple[int, str | None]]] = {}
    masters: dict[str, Mapping[str, Any]] = {}
    for entry in entries:
        if entry["kind"] == MARK:
            name = _identity(entry)
            last[name] = entry
            copies.setdefault(name, []).append((entry["sequence"], entry["recipient"]))
            if entry["master"] is not None:
                masters[name] = entry["master"]
    return [_origin(entry, copies[name], masters.get(name)) for name, entry in last.items()]


def _identity(entry: Mapping[str, Any]) -> str:
    manifest = entry["manifest"]
    source = {name: value for name, value in manifest["source"].items() if name != "path"}
    source["files"] = [each["sha256"] for each in source["files"]]
    same = ("key_id", "plugins", "layers")
    names = [entry["asset"], entry["version"]]
    return canonical({"names": names, "source": source, **{name: manifest[name] for name in same}})


def _origin(
    entry: Mapping[str, Any],
    copies: Sequence[tuple[int, str | None]],
    master: Mapping[str, Any] | None,
) -> Origin:
    """Tell of the origin of some copies by the entry of the last."""
    manifest = entry["manifest"]
    source = manifest["source"]
    variants = {"variants": source["variants"]} if "variants" in source else {}
    return Origin(
        asset=entry["asset"],
        version=entry["version"],
        key_id=entry["key_id"],
        source=_source(entry),
        digests=tuple(each["sha256"] for each in source["files"]),
        parameters={**source.get("parameters", {}), **variants},
        plugins=manifest["plugins"],
        layers=tuple(manifest["layers"]),
        meshes=tuple((prim["points"], prim["faces"]) for prim in manifest["prims"]),
        copies=tuple(copies),
        master=master,
    )


def _source(entry: Mapping[str, Any]) -> Path:
    """Tell where the source was: the manifest tells it relative to where the copy was made."""
    if "original" in entry:
        return Path(entry["original"])
    kind = PureWindowsPath if WINDOWS.match(entry["output"]) else PurePosixPath
    return Path(str(kind(entry["output"]).parent / entry["manifest"]["source"]["path"]))
