"""The journeys of the reports: from a verdict, or a manifest, to a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from meshmark.commands.identification import Identification
from meshmark.commands.verification import Request
from meshmark.detection.informed_pairs import aligned, pairs
from meshmark.detection.verdict import Verdict
from meshmark.embedding.manifest import manifest_path, output_hashes
from meshmark.errors import CapacityError, OutputError, UsageError
from meshmark.extension.recipe import Recipe
from meshmark.mesh.asset import Asset
from meshmark.mesh.breakdown import breakdown_means_no_capacity
from meshmark.reporting.copy_facts import Asked, copy_facts
from meshmark.reporting.distances import LABEL, Distances
from meshmark.reporting.mark_facts import mark_facts
from meshmark.reporting.page import page
from meshmark.reporting.selection import select
from meshmark.reporting.sources import Hashed, Sources, hashed
from meshmark.reporting.view import View, view_of
from meshmark.sources.digests import sha256
from meshmark.sources.reading import read
from meshmark.sources.writing import read_back
from meshmark.workers.ordered_map import sharing_workers

SUFFIXES = (".html", ".htm")
DISPLACEMENT = "Displacement by the mark"


def require_page(output: Path) -> None:
    """Refuse a place for a page that may be that of something else, or is none.

    Raises
    ------
    UsageError
        If it is not called like a page.
    OutputError
        If there is no such folder.
    """
    if output.suffix.lower() not in SUFFIXES:
        raise UsageError(f"a report is an HTML page: *{SUFFIXES[0]}", source=output)
    if not output.parent.is_dir():
        raise OutputError("the folder to write into does not exist", source=output.parent)
    if output.is_dir():
        raise OutputError("is a folder", source=output)


@sharing_workers
def copy_page(
    sources: Sources,
    verdict: Verdict,
    request: Request,
    *,
    command: str,
    found: Identification | None = None,
    jobs: int = 1,
) -> str:
    """Report on a copy.

    Parameters
    ----------
    sources : Sources
        The copy, and what it was read beside.
    verdict : Verdict
    request : Request
        What was asked.
    command : str
        What repeats the report, without the key.
    found : Identification, optional
        What a ledger knows of it.
    jobs : int
        Processes that work, this one among them.

    Raises
    ------
    InputError
        If a file was changed since it was read.
    """
    copy, original = sources.copy, request.original
    recipes = request.recipes_for(copy.source)
    schemes = tuple(_scheme(recipe.as_json()["scheme"]) for recipe in recipes)
    best = None if found is None else found.best
    if best is not None and best.origin is not None:
        schemes = tuple(map(_scheme, best.origin.layers))
        if best.by_shape:
            sources, original = sources.beside(best.origin), best.origin.source.name
    asked = Asked(
        copy=copy.source,
        key_id=request.key_id,
        fpr=request.fpr,
        original=original,
        command=command,
        files=tuple(file.told for file in sources.files),
        schemes=schemes,
    )
    view = _shown(partial(_copy_view, sources, recipes, request.frames, jobs))
    sources.require_unchanged()
    return page(copy_facts(asked, verdict, found), view)


def _scheme(told: Mapping[str, Any]) -> tuple[str, str]:
    return told["name"], told["version"]


def _copy_view(
    sources: Sources, recipes: Sequence[Recipe], frames: str | None, jobs: int
) -> View | None:
    """Show a copy, and how far it is from its original, if it lies on one."""
    copy, original = sources.copy, sources.original
    chosen = select(copy, recipes, frames)
    if chosen is None:
        return None
    if original is not None:
        # The verdict rests on the same.
        placed = [
            mesh
            for pair in pairs(copy, original, frames)
            for mesh in aligned(pair, copy, original, frames=frames, jobs=jobs).meshes
        ]
        if placed:
            distances = Distances(placed)
            times = distances.times(chosen.lead.times)
            return view_of(copy, chosen.at(times), label=LABEL, values=distances)
    return view_of(copy, chosen)


def _mark_view(original: Asset, written: Asset, recipes: Sequence[Recipe]) -> View | None:
    """Show a file before and after it was marked."""
    chosen = select(original, recipes)
    if chosen is None:
        return None
    return view_of(original, chosen, label=DISPLACEMENT, marked=written)


def _shown(make: Callable[[], View | None]) -> View | None:
    """Make a view; of shapes that are too degenerate to compute on, a page has none."""
    try:
        with breakdown_means_no_capacity():
            return make()
    except CapacityError:
        return None


def mark_page(
    manifest: Mapping[str, Any],
    source: str,
    output: Path,
    *,
    recipes: Sequence[Recipe],
    parameters: Mapping[str, Any] | None,
    command: str,
    master: Path | None = None,
    trusted: bool = True,
) -> str:
    """Report on a file that was marked, and is in its place.

    Parameters
    ----------
    manifest : mapping
        What was done; see `meshmark.embedding.manifest`.
    source : str
        What was marked.
    output, master : Path
        What was written.
    recipes : sequence of Recipe
        The layers of the mark.
    parameters : mapping, optional
        Of the reader of the source.
    command : str
        What repeats it, without the key.
    trusted : bool
        Whether the source is read in this process.
    """
    prims = [prim["prim"] for prim in manifest["prims"]]
    original = read(source, prims, parameters=parameters, isolated=not trusted)
    written = read_back(original, output, prims, parameters)
    view = _shown(partial(_mark_view, original, written, recipes))
    files = [*hashed("source", original), *_written("output", output)]
    files += [] if master is None else _written("master", master)
    if "c2pa" in manifest:
        files.append(Hashed("credentials", manifest["c2pa"]["file"], manifest["c2pa"]["sha256"]))
    place = manifest_path(output)
    files.append(Hashed("manifest", str(place), sha256(place)))
    told = tuple(file.told for file in files)
    return page(mark_facts(manifest, str(output), told, command), view)


def _written(role: str, output: Path) -> list[Hashed]:
    return [Hashed(role, each["file"], each["sha256"]) for each in output_hashes(output)]
