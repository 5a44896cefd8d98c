"""Looks at a file that is to leave the house, or has left it, from outside."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from meshmark.errors import InputError
from meshmark.manifest import manifest_path
from meshmark.sources import STAGE_SUFFIXES


def check_file(file: str | Path) -> dict[str, Any]:
    """List what a deliverable gives away: shapes, layers, paths and words.

    Where its manifest lies beside it, the meshes that this says are marked may resemble each
    other.

    Returns
    -------
    dict
        JSON values, as `check --json` prints them; the schema is
        `schemas/json/check.schema.json`.

    Raises
    ------
    InputError
        If it cannot be read, or is no stage.
    """
    name = str(file)
    if not name.lower().endswith(STAGE_SUFFIXES):
        raise InputError(f"only {', '.join(STAGE_SUFFIXES)} can be checked", source=name)
    from meshmark.usd.checking import check_stage

    findings = check_stage(name, _marked_meshes(Path(name)))
    return {"file": name, "findings": [asdict(each) for each in findings]}


def _marked_meshes(file: Path) -> list[str]:
    path = manifest_path(file)
    if not path.is_file():
        return []
    try:
        document = json.loads(path.read_text())
        return [str(each["prim"]) for each in document["prims"]]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"is no manifest: {error}", source=path) from None
