"""The sidecar beside a marked file: where it lies, and what it claims.

It travels with the copy. So it tells the schemes and a record id, which says something to the owner
only: neither the source, nor the recipient, nor the key.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from meshmark.errors import UsageError
from meshmark.version import __version__

SUFFIX = ".c2pa"
# No format of meshes is known to C2PA tools. They hash such a file whole, and embed nothing in it.
ANY_FORMAT = "application/octet-stream"
BINDING = "c2pa.soft-binding"
SOURCE = "source"
# Nothing is ever fetched, nor is what was signed read again by the library itself.
OFFLINE = {
    "verify_after_sign": False,
    "verify_trust": True,
    "remote_manifest_fetch": False,
    "ocsp_fetch": False,
}


def sidecar_path(file: Path) -> Path:
    """Return the place of a file's sidecar, where other C2PA tools look for it, too."""
    return file.with_suffix(SUFFIX)


def algorithm_of(scheme: Mapping[str, Any]) -> str:
    """Name a scheme, as a manifest tells of it, as a soft-binding algorithm."""
    return f"meshmark.{scheme['name']}.{scheme['version']}"


def claims(record: str, algorithms: Sequence[str]) -> dict[str, Any]:
    """Say that something was opened, and marked by some schemes under a record id.

    Returns
    -------
    dict
        A manifest definition, as c2pa-python takes it.
    """
    actions = [
        {"action": "c2pa.opened", "parameters": {"ingredientIds": [SOURCE]}},
        {"action": "c2pa.watermarked.bound"},
    ]
    bindings = [
        {"label": BINDING, "data": {"alg": each, "blocks": [{"scope": {}, "value": record}]}}
        for each in algorithms
    ]
    return {
        "claim_generator_info": [{"name": "meshmark", "version": __version__}],
        # A claim of an edit needs to say that there was something, not what.
        "ingredients": [
            {
                "label": SOURCE,
                "title": "unmarked asset",
                "format": ANY_FORMAT,
                "relationship": "parentOf",
            }
        ],
        "assertions": [{"label": "c2pa.actions.v2", "data": {"actions": actions}}, *bindings],
    }


def require_installed() -> None:
    """Refuse to go on without the library.

    Raises
    ------
    UsageError
        If it is not installed.
    """
    if find_spec("c2pa") is None:
        raise UsageError(
            "content credentials need c2pa-python, which is not installed: "
            "pip install 'meshmark[c2pa]'"
        )
