"""A hook of Prism, called after an export: the marked file takes the place of the exported one.

Copy this file to `00_Pipeline/Hooks/postExport.py` in the project, and fill in what follows.
"""

from __future__ import annotations

from fnmatch import fnmatch
from pathlib import Path
from typing import Any

from meshmark.keys import Key
from meshmark_plugins.publish.marking import holds_meshes, mark, marked_before
from meshmark_plugins.publish.recording import Recorder

KEY_FILE = ""
RECIPIENT: str | None = None
# Where marks, and waived ones, are recorded; see docs/ledger.md.
LEDGER = ""
# What else `meshmark.mark_file` is to be told; see `marking.mark`.
OPTIONS: dict[str, Any] = {}
# Patterns of paths, and who allows, and why, that what can hold no mark stays unmarked there.
WAIVERS: dict[str, str] = {}


def main(*_: Any, **export: Any) -> dict[str, Any] | None:
    """Mark what was exported; Prism calls this with what it knows of the export, by name.

    Prism goes on whatever happens here, but tells of an error if the exported file is not in its
    place. So it leaves its place first.

    Returns
    -------
    dict or None
        What became of the file; None if it holds no meshes.

    Raises
    ------
    MeshmarkError
        If it cannot be marked. It is then in `NAME.unmarked`.
    """
    path = Path(export["outputpath"])
    if not holds_meshes(path):
        return None
    waiver = next((why for each, why in WAIVERS.items() if fnmatch(str(path), each)), None)
    before = marked_before(path, Key.load(Path(KEY_FILE)), RECIPIENT, waiver)
    if before is not None:
        return before.told
    aside = path.with_stem(f"{path.stem}.unmarked")
    path.replace(aside)
    try:
        published = mark(
            aside,
            path,
            KEY_FILE,
            recipient=RECIPIENT,
            waiver=waiver,
            options=OPTIONS,
            recorder=Recorder.of(LEDGER, None, None),
        )
    except BaseException:
        aside.replace(path.with_name(f"{path.name}.unmarked"))
        raise
    if published.path == aside:
        aside.replace(path)
    else:
        aside.unlink()
    return published.told
