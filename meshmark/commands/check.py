"""Looks at a file that is to leave the house, or has left it, from outside."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from meshmark.embedding.manifest import manifest_path
from meshmark.errors import InputError, MeshmarkError
from meshmark.files.temporary import ScratchFolder
from meshmark.sources.isolation.limits import Limits
from meshmark.sources.isolation.reading import environment
from meshmark.sources.isolation.report import describe_error, error_from
from meshmark.usd.names import STAGE_SUFFIXES
from meshmark.usd.reader import UsdReader


def check_file(file: str | Path, *, trusted: bool = False) -> dict[str, Any]:
    """List what a deliverable gives away: shapes, layers, paths and words.

    Unless it is trusted, a process of its own looks at it, which it could crash or hang.

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
    if not UsdReader().accepts(name):
        raise InputError(f"only {', '.join(STAGE_SUFFIXES)} can be checked", source=name)
    if not Path(name).is_file():
        raise InputError("no such file", source=name)
    if trusted:
        from meshmark.usd.checking import check_stage

        findings = check_stage(name, _marked_meshes(Path(name)))
        return {"file": name, "findings": [asdict(each) for each in findings]}
    folder = ScratchFolder()
    said = subprocess.run(
        [sys.executable, "-P", "-m", __name__, name],
        env=environment(folder.path),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        check=False,
    )
    folder.remove()
    if said.returncode:
        raise InputError(
            f"crashes the USD library ({said.returncode}), or needs more memory or time than it "
            "is given",
            source=name,
        )
    told = json.loads(said.stdout)
    if "error" in told:
        raise error_from(told["error"])
    return dict(told)


def _check_within_limits(file: str) -> dict[str, Any]:
    limits = Limits.from_environment()
    limits.impose(file)
    limits.expect_progress()
    from meshmark.usd.checking import check_stage

    try:
        marked = _marked_meshes(Path(file))
        findings = check_stage(file, marked, beat=limits.expect_progress)
    except MeshmarkError as error:
        return {"error": describe_error(error)}
    return {"file": file, "findings": [asdict(each) for each in findings]}


def _marked_meshes(file: Path) -> list[str]:
    path = manifest_path(file)
    if not path.is_file():
        return []
    try:
        document = json.loads(path.read_text())
        return [str(each["prim"]) for each in document["prims"]]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(f"is no manifest: {error}", source=path) from None


if __name__ == "__main__":
    # What libraries print is no part of the answer.
    answer = os.dup(1)
    os.dup2(2, 1)
    document = _check_within_limits(sys.argv[1])
    with os.fdopen(answer, "w") as stdout:
        json.dump(document, stdout)
    # Without taking down libraries that a hostile file has been through.
    os._exit(0)
