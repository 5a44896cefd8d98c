"""`meshmark align`."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from meshmark.cli.console import put_json, say
from meshmark.cli.options import (
    ClipOption,
    FpsOption,
    FramesOption,
    JsonOption,
    TrustedOption,
    VariantOption,
    reader_parameters,
    require_taken,
)

NOTHING_FITS = 4


def align(
    copy: Annotated[str, typer.Argument(help="The copy to place.", show_default=False)],
    original: Annotated[
        str, typer.Option("--original", metavar="SOURCE", help="What it may be a copy of.")
    ],
    frames: FramesOption = None,
    clip: ClipOption = None,
    fps: FpsOption = None,
    variant: VariantOption = [],  # noqa: B006 (typer makes a new list each time)
    trusted: TrustedOption = False,
    json: JsonOption = False,
) -> None:
    """Find where COPY lies on its original: mesh, pose, similarity; exit code 4 if nowhere."""
    from meshmark.commands.align import align_assets
    from meshmark.sources.readers import parameters_for
    from meshmark.sources.reading import read
    from meshmark.workers.ordered_map import default_jobs

    parameters = reader_parameters(clip, fps, variant)
    require_taken(parameters, [copy, original])
    own, of_copy = parameters_for(original, parameters), parameters_for(copy, parameters, copy=True)
    ours = read(original, parameters=own, isolated=not trusted)
    theirs = read(copy, parameters=of_copy, isolated=not trusted)
    document = align_assets(theirs, ours, frames=frames, jobs=default_jobs())
    if json:
        put_json(document)
    _tell(document)
    if not document["meshes"]:
        raise typer.Exit(NOTHING_FITS)


def _tell(document: dict[str, Any]) -> None:
    total = len(document["meshes"]) + len(document["unplaced"])
    say(f"{document['copy']}: {len(document['meshes'])} of {total} mesh(es) found")
    for mesh in document["meshes"]:
        poses = [frame["pose"] for frame in mesh["frames"]]
        say(
            f"  {mesh['prim']}: {' + '.join(mesh['copy_prims'])} by {mesh['method']}, "
            f"{len(poses)} frames show poses {min(poses):g} to {max(poses):g}, "
            f"{mesh['covered']:.0%} covered, residual {mesh['residual']:.1e}"
        )
    for each in document["unplaced"]:
        say(f"  {each['prim']}: not found: {each['reason']}")
