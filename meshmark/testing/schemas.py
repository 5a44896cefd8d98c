"""Where the schemas shipped with the package are."""

from __future__ import annotations

from pathlib import Path


def schema_folder(kind: str) -> Path:
    """Return the folder of the shipped schemas of one kind.

    A wheel holds them inside the package; in a source tree they stand beside it.

    Parameters
    ----------
    kind : str
        Folder under `schemas/`, such as "json".

    Raises
    ------
    FileNotFoundError
        If the installation is damaged.
    """
    package = Path(__file__).resolve().parent.parent
    candidates = (package / "schemas" / kind, package.parent / "schemas" / kind)
    for folder in candidates:
        if folder.is_dir():
            return folder
    raise FileNotFoundError(f"no {kind} schemas at {candidates[0]}; reinstall meshmark")
