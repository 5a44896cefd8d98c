"""Writes the table of docs/delivery.md: what a delivery takes out of real files, and moves along.

usage: python benchmarks/delivery_table.py FOLDER

Every USD file of the folder is delivered with small random moves in place of a mark: what else
happens to the file does not depend on them.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from meshmark.delivery.unmarked import split_fit
from meshmark.errors import MeshmarkError
from meshmark.mesh.animation import Frame
from meshmark.usd.checking import check_stage
from meshmark.usd.delivery import write_flattened
from meshmark.usd.opening import stage_files
from meshmark.usd.reading import read_stage

SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")


def moved(frame: Frame) -> Frame:
    """Move every point by about a thousandth of the diagonal."""
    size = 1e-3 * np.linalg.norm(np.ptp(frame.points, axis=0))
    seed = 0 if np.isnan(frame.time) else abs(int(1000 * frame.time))
    step = np.random.default_rng(seed).uniform(-size, size, frame.points.shape)
    return frame.moved(frame.points + step)


def row(file: Path, folder: Path, output: Path) -> str:
    """Deliver one file, and tell of it in one row."""
    name = f"`{file.relative_to(folder)}`"
    try:
        asset = split_fit(read_stage(str(file)))
        marked = replace(asset, meshes=tuple(mesh.map(moved) for mesh in asset.meshes))
        told = write_flattened(asset, marked, output)
        found = check_stage(str(output), [mesh.prim for mesh in asset.meshes])
    except MeshmarkError as error:
        reason = error.message.replace(str(file), file.name).partition(". ")[0]
        return f"| {name} | | | | | refused: {reason} |"
    left = [f"`{each.prim}`: {each.reason.split(' @')[0]}" for each in asset.left_out]
    copies = ", ".join(f"`{each.path}`" for each in told.moved)
    # The same metadata on many prims is one line.
    words = Counter(re.sub(r"^.*?: ", "", each) for each in told.removed)
    removed = ", ".join(f"`{word}` x {n}" if n > 1 else f"`{word}`" for word, n in words.items())
    remarks = [f"left out: {each}" for each in left] + [f"found: {each.where}" for each in found]
    files = len(stage_files(str(file)))
    return (
        f"| {name} | {files} | {len(asset.meshes)} | {copies} | {removed} | {'; '.join(remarks)} |"
    )


def main(folder: Path) -> None:
    """Print the table."""
    print("| file | files merged | meshes | moved along | removed | remarks |")
    print("|---|---|---|---|---|---|")
    files = sorted(path for path in folder.rglob("*") if path.suffix in SUFFIXES)
    with tempfile.TemporaryDirectory() as name:
        for number, file in enumerate(files):
            print(row(file, folder, Path(name) / f"{number}.usdc"))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
