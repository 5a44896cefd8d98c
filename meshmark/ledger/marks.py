"""What the ledger records: of a marked copy, the manifest, and where all lies; and waived marks."""

from __future__ import annotations

import hashlib
import unicodedata
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from meshmark.errors import UsageError

MARK, WAIVER = "mark", "waiver"
# Characters of the name of an asset or version; hexadecimal digits of a version that has no name.
LONGEST, DIGITS = 256, 12


def mark_of(
    manifest: Mapping[str, Any],
    output: Path,
    *,
    asset: str | None = None,
    version: str | None = None,
    master: Mapping[str, Any] | None = None,
    published: Path | None = None,
) -> dict[str, Any]:
    """Tell of a marked copy, as the ledger records it.

    Parameters
    ----------
    manifest : mapping
        As it was written beside the output.
    output : Path
        Where the copy was written to.
    asset, version : str, optional
        Of what it is a copy: by default the name of the source without its suffix, and the first
        digits of the hash of its files.
    master : mapping, optional
        Where the master was kept, `path` and `files`.
    published : Path, optional
        Where the copy goes from there, and stays.

    Raises
    ------
    UsageError
        If a name is empty, too long, or holds control characters.
    """
    source = manifest["source"]
    # The manifest tells of the source relative to where the copy was written.
    original = str((output.absolute().parent / source["path"]).resolve())
    return {
        "kind": MARK,
        "asset": asset_name(Path(source["path"]).stem if asset is None else asset),
        "version": asset_name(_digest(source["files"]) if version is None else version),
        "recipient": manifest["recipient"],
        "key_id": manifest["key_id"],
        "output": str((published or output).absolute()),
        **({} if published is None else {"original": original}),
        "master": None if master is None else dict(master),
        "manifest": dict(manifest),
    }


def waiver_of(
    source: Path,
    files: list[dict[str, str]],
    *,
    waiver: str,
    reason: str,
    recipient: str | None = None,
    asset: str | None = None,
    version: str | None = None,
) -> dict[str, Any]:
    """Tell of what was published unmarked, as the ledger records it.

    Parameters
    ----------
    source : Path
        What was published, or is in a marked copy of it.
    files : list of {"file", "sha256"}
        Its files.
    waiver, reason : str
        Who allowed it, and why; and why it could not be marked.
    recipient, asset, version : str, optional
        As in `mark_of`.

    Raises
    ------
    UsageError
        If a name is empty, too long, or holds control characters.
    """
    return {
        "kind": WAIVER,
        "asset": asset_name(source.stem if asset is None else asset),
        "version": asset_name(_digest(files) if version is None else version),
        "recipient": recipient,
        "key_id": None,
        "source": {"path": str(source.absolute()), "files": files},
        "waiver": waiver,
        "reason": reason,
    }


def _digest(files: list[dict[str, str]]) -> str:
    digests = [each["sha256"] for each in files]
    whole = digests[0] if len(digests) == 1 else hashlib.sha256("".join(digests).encode())
    return (whole if isinstance(whole, str) else whole.hexdigest())[:DIGITS]


def asset_name(text: str) -> str:
    """Return the form in which the ledger keeps the name of an asset, or of a version.

    Raises
    ------
    UsageError
        If it is empty, too long, or holds control characters.
    """
    # Names of files need not be text.
    readable = text.encode("utf-8", "replace").decode()
    name = unicodedata.normalize("NFC", readable.strip())
    if not name or len(name) > LONGEST or any(unicodedata.category(c) == "Cc" for c in name):
        raise UsageError(
            f"the name of an asset or version has 1 to {LONGEST} characters, none that control"
        )
    return name
