"""The C2PA sidecar of a marked file: where it may be written, and what the manifest tells of it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meshmark.c2pa.sidecar import algorithm_of, sidecar_path
from meshmark.embedding.manifest import own_manifest
from meshmark.errors import OutputError, UsageError
from meshmark.files.atomic import write_bytes
from meshmark.files.places import require_apart, require_names_fit
from meshmark.mesh.asset import Asset
from meshmark.sources.facts import files_in_reach
from meshmark.usd.names import LAYER_SUFFIXES

if TYPE_CHECKING:
    from meshmark.c2pa.signing import Signer

# Of files that hold all that is marked: a sidecar is about one.
SIGNED_SUFFIXES = (*LAYER_SUFFIXES, ".glb")


def require_place(output: Path, original: Asset) -> None:
    """Refuse an output that no sidecar can be about, or whose sidecar would replace another's.

    Raises
    ------
    UsageError
        If it is not one file that holds all.
    OutputError
        If what is in the sidecar's place belongs to something else.
    """
    if output.suffix.lower() not in SIGNED_SUFFIXES:
        raise UsageError(f"--c2pa signs one of {', '.join(SIGNED_SUFFIXES)}", source=output)
    place = sidecar_path(output)
    require_names_fit([place])
    require_apart([place], files_in_reach(original))
    if place.exists() and "c2pa" not in (own_manifest(output) or {}):
        raise OutputError(f"is in the way: nothing tells that it is of {output}", source=place)


def write_sidecar(document: Mapping[str, Any], output: Path, signer: Signer) -> dict[str, Any]:
    """Sign an output that is in place, write its sidecar, and tell of it.

    Parameters
    ----------
    document : mapping
        The manifest, with the run's record.

    Raises
    ------
    InputError
        If it cannot be signed.
    OutputError
        If the sidecar cannot be written.
    """
    place = sidecar_path(output)
    algorithms = [algorithm_of(scheme) for scheme in document["layers"]]
    content = signer.sidecar(output, document["record"], algorithms)
    write_bytes(content, place)
    return {"file": place.name, "sha256": hashlib.sha256(content).hexdigest()}
