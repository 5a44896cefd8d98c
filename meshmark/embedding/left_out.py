"""What of a source holds no mark: what may, what may not, and what the manifest tells of it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from meshmark.delivery.unmarked import require_allowed, require_extent, split_fit
from meshmark.embedding.asset import MarkedAsset
from meshmark.errors import NoExtentError
from meshmark.mesh.asset import Asset, LeftOut


def markable_of(original: Asset, deliver: bool, allow_unmarked: Sequence[str]) -> Asset:
    """Leave out what cannot be marked; refuse to deliver what nobody allowed to go unmarked."""
    markable = split_fit(original)
    if not deliver:
        return markable
    require_allowed(markable, allow_unmarked)
    require_extent(markable, allow_unmarked)
    return markable


def told_of_skipped(
    marked: MarkedAsset, markable: Asset, others: Iterable[LeftOut], deliver: bool
) -> list[dict[str, str]]:
    """Tell of the meshes that hold no mark. Guides count in a deliverable only."""
    left_out = [each for each in markable.left_out if deliver or not each.guide]
    skipped = (*marked.skipped, *left_out, *others)
    return [{"prim": each.prim, "reason": each.reason} for each in skipped]


def unheld(marked: MarkedAsset) -> list[LeftOut]:
    """List the frames of marked meshes that can hold no mark, though they show something."""
    return [
        LeftOut(mesh.original.prim, f"frame {time:g}: {error.message}")
        for mesh in marked.meshes
        for time, error in mesh.passed_over
        if not isinstance(error, NoExtentError)
    ]
