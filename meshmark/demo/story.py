"""The demonstration: a creature is made, marked, leaked and found again."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from meshmark.commands.attack import attack_asset, write_attacked
from meshmark.demo import write_creature
from meshmark.detection.verdict import Verdict
from meshmark.detection.verify import verify
from meshmark.embedding.file import mark_file
from meshmark.errors import OutputError
from meshmark.extension.recipe import Recipe
from meshmark.extension.registry import make_attack
from meshmark.keys import Key
from meshmark.mesh.frame_range import AUTO
from meshmark.sources.reading import read
from meshmark.workers.progress import StageProgress

SEED = 1
FRAMES = 24
ATTACKS: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("noisy", "noise", {"amplitude": 0.001}),
    ("cropped", "cropping", {"share": 0.1}),
)


def tell(folder: Path, *, jobs: int, progress: StageProgress | None = None) -> Iterator[str]:
    """Run the demonstration and tell of it, line by line.

    Parameters
    ----------
    folder : Path
        Where the files go. Files of an earlier run are replaced, its key is used again.

    Yields
    ------
    str
        The story, with figures measured on the way.

    Raises
    ------
    OutputError
        If the folder cannot be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot make the folder: {error.strerror}", source=folder) from None
    original, marked = folder / "creature.usdc", folder / "creature.marked.usdc"
    [animation] = read(write_creature(original, frames=FRAMES)).meshes
    yield (
        f"A creature of {animation[0].topology.n_points} points gallops through "
        f"{len(animation)} frames: {original}"
    )
    key = _key(folder / "studio.key")
    yield f"The studio's key is {folder / 'studio.key'} (id {key.id})."
    start = time.perf_counter()
    manifest = mark_file(original, marked, key, jobs=jobs, progress=progress)
    [prim] = manifest["prims"]
    found = prim["distortion"]
    yield (
        f"Marked in {time.perf_counter() - start:.1f} s: {marked} moves the surface by "
        f"{found['mrms_rel']:.1e} of the creature's size (MRMS), {found['hausdorff_rel']:.1e} "
        "where it shows most, and turns "
        f"{found['flipped_faces']:g} faces over."
    )
    yield ""
    yield f"{'who is asked':<42}{'verdict':<15}{'log10 p':>8}{'BER avg':>9}"
    yield _row("the original, unmarked", _ask(original, key, jobs))
    yield _row("the marked copy", _ask(marked, key, jobs))
    for label, name, parameters in ATTACKS:
        leaked = folder / f"creature.{label}.usdc"
        attacked = attack_asset(read(marked), make_attack(name, **parameters), SEED)
        write_attacked(replace(attacked, source=str(leaked)), leaked)
        shown = ", ".join(f"{key} {value:g}" for key, value in parameters.items())
        yield _row(f"a leaked copy: {name}, {shown}", _ask(leaked, key, jobs))
    yield _row("the marked copy, a wrong key", _ask(marked, Key.generate(), jobs))
    yield ""
    yield (
        "log10 p bounds the chance that a key drawn at random fits as well: -6 is one in a "
        "million, and the least that counts as marked."
    )
    yield f"Try it yourself: meshmark verify {marked} --key {folder / 'studio.key'}"


def _key(path: Path) -> Key:
    if not path.exists():
        Key.generate().save(path)
    return Key.load(path)


def _ask(source: Path, key: Key, jobs: int) -> Verdict:
    return verify(read(source), key, recipes=[Recipe()], frames=AUTO, jobs=jobs)


def _row(label: str, verdict: Verdict) -> str:
    rate = verdict.prims[0].finding.errors.average if verdict.prims else np.nan
    # A short look may decide no bit.
    ber = "-" if np.isnan(rate) else f"{rate:.3f}"
    return f"{label:<42}{verdict.verdict:<15}{verdict.log10_p:>8.1f}{ber:>9}"
