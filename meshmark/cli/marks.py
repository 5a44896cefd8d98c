"""What is printed of a marked file: what became of its meshes, and what is not as one may think."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from meshmark.cli.console import by_text, few, say, warn


def tell_meshes(document: Mapping[str, Any], every: bool) -> None:
    """Print what became of each mesh.

    Parameters
    ----------
    document : mapping
        The manifest.
    every : bool
        Print every message, not only the first few of each kind.
    """
    missing = [
        (prim["prim"], f"no mark by {layer['scheme']}: {layer['reason']}")
        for prim in document["prims"]
        for layer in prim["missing"]
    ]
    for text in _remarks(missing, every):
        warn(text)
    for prim in document["prims"]:
        for note in prim["notes"]:
            warn(f"{prim['prim']}: {note}")
        for frame in prim["passed_over"]:
            warn(f"{prim['prim']}: frame {frame['time']:g} stays as it is: {frame['reason']}")
        found = prim["distortion"]
        say(
            f"{prim['prim']}: {prim['marked_frames']} frames of {prim['points']} points, "
            f"{prim['carriers']} carriers; MRMS {found['mrms_rel']:.2e} and Hausdorff "
            f"{found['hausdorff_rel']:.2e} of the diagonal; "
            f"log10 p {prim['verification']['log10_p']:.1f}"
            if prim["verification"]
            else f"{prim['prim']}: nothing is found again"
        )


def tell_remarks(document: Mapping[str, Any], every: bool) -> None:
    """Warn of what is unmarked, shared or only in some variants, and of a mark that is weak.

    Parameters are those of `tell_meshes`.
    """
    few([_told_of_variants(each) for each in document.get("variants", [])], every)
    shared = document.get("shared_shapes", [])
    few([f"{shape}: this blend shape stays: several meshes share it" for shape in shared], every)
    _tell_delivery(document.get("delivery"), every)
    skipped = [(each["prim"], f"not marked: {each['reason']}") for each in document["skipped"]]
    few(_remarks(skipped, every), every)
    found = document["verification"]
    if found["verdict"] != "marked":
        warn(
            f"what was written verifies with log10 p {found['log10_p']:.2f} only: "
            f"{found['verdict']} at {found['fpr']:g}"
        )


def _remarks(remarks: Sequence[tuple[str, str]], every: bool) -> list[str]:
    """Say of each prim, or once of all, what is said of it."""
    return [f"{prim}: {text}" for prim, text in remarks] if every else by_text(remarks)


def _told_of_variants(found: dict[str, Any]) -> str:
    others = ", ".join(found["as_they_are"])
    return f"{found['prim']}: marked in {' and '.join(found['marked_in'])} only, not in {others}"


def _tell_delivery(delivery: dict[str, Any] | None, every: bool) -> None:
    if delivery is None:
        return
    moved = [f"{each['path']}: moved with {each['prim']}" for each in delivery["moved"]]
    few(moved, every, tell=say)
    few([f"removed: {each}" for each in delivery["removed"]], every, tell=say)
    few(
        [f"{path}: leads out of the folder of the deliverable" for path in delivery["outside"]],
        every,
    )
