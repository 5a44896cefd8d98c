"""Which options of `mark_file` go together."""

from __future__ import annotations

from collections.abc import Sequence

from meshmark.errors import UsageError
from meshmark.usd.names import BAKE, FOLLOW, KEEP, REST_POSE


def require_sensible(
    deliver: bool,
    frames: str | None,
    allow_unmarked: Sequence[str],
    keep_metadata: bool,
    skel: str,
    primvars: str,
) -> None:
    """Refuse options that contradict each other.

    Raises
    ------
    UsageError
        With the first that does.
    """
    if skel not in (BAKE, REST_POSE):
        raise UsageError(f"--skel {skel}: it must be {BAKE} or {REST_POSE}")
    if primvars not in (FOLLOW, KEEP):
        raise UsageError(f"--primvars {primvars}: it must be {FOLLOW} or {KEEP}")
    if skel == REST_POSE and frames is not None:
        raise UsageError("--skel rest with --frames: a rest pose shows in every frame")
    if deliver and frames is not None:
        raise UsageError("--deliver with --frames would deliver the other frames unmarked")
    if allow_unmarked and not deliver:
        raise UsageError("--allow-unmarked is for --deliver only")
    if keep_metadata and not deliver:
        raise UsageError("--keep-metadata is for --deliver only")
