"""`meshmark inspect`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from meshmark.cli.console import put_json
from meshmark.cli.options import (
    ClipOption,
    FpsOption,
    GeodesicOption,
    JsonOption,
    SegmenterOption,
    SetOption,
    SourceArgument,
    TrustedOption,
    VariantOption,
    reader_parameters,
)
from meshmark.extension.defaults import DEFAULT_GEODESIC, DEFAULT_LAYERS, DEFAULT_SEGMENTER

CANNOT_HOLD = 1
# Runs of frames that are printed.
FEW_RUNS = 8


def inspect(
    source: SourceArgument,
    scheme: Annotated[
        list[str], typer.Option(help="Watermarking scheme; several are layers of one mark.")
    ] = list(DEFAULT_LAYERS),  # noqa: B006 (typer makes a new list each time)
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    geodesic: GeodesicOption = DEFAULT_GEODESIC,
    settings: SetOption = [],  # noqa: B006
    clip: ClipOption = None,
    fps: FpsOption = None,
    variant: VariantOption = [],  # noqa: B006
    trusted: TrustedOption = False,
    json: JsonOption = False,
) -> None:
    """List what is in SOURCE, and whether it can hold a mark; exit code 1 if a mesh cannot."""
    from meshmark.commands.inspect import inspect_asset
    from meshmark.extension.recipe import layers_from_text
    from meshmark.sources.reading import read

    layers = layers_from_text(scheme, segmenter, geodesic, settings)
    document = inspect_asset(
        read(source, parameters=reader_parameters(clip, fps, variant), isolated=not trusted), layers
    )
    if json:
        put_json(document)
    else:
        _tell(document)
    missing = [each for each in document["left_out"] if not each["guide"]]
    if missing or not all(prim["can_hold"] for prim in document["prims"]):
        raise typer.Exit(CANNOT_HOLD)


def _tell(document: dict[str, Any]) -> None:
    typer.echo(f"{document['source']}: {len(document['prims'])} mesh(es)")
    for note in document["notes"]:
        typer.echo(f"  note: {note}")
    for prim in document["prims"]:
        kind = (
            f", connectivity changes over time: {len(prim['runs'])} runs" if "runs" in prim else ""
        )
        typer.echo(
            f"  {prim['prim']}: {_frames(prim)}, {_points(prim)}, {prim['faces']} faces{kind}"
        )
        for note in prim["notes"]:
            typer.echo(f"    note: {note}")
        _tell_runs(prim.get("runs", []))
        if prim["can_hold"]:
            typer.echo(
                f"    can hold a mark: {prim['parts']} parts, {prim['carriers']} carriers, "
                f"{prim['chips']} chips, "
                f"log10 p down to {prim['reachable_log10_p']:.1f}"
            )
        else:
            typer.echo(f"    cannot hold a mark: {prim['reason']}")
        for layer in prim["layers"]:
            if prim["can_hold"] and not layer["can_hold"]:
                typer.echo(f"    no mark by {layer['scheme']}: {layer['reason']}")


def _frames(prim: dict[str, Any]) -> str:
    if prim["times"] is None:
        return "1 frame of no time"
    first, last = prim["times"]
    return f"{prim['frames']} frames from {first:g} to {last:g}"


def _points(prim: dict[str, Any]) -> str:
    """Say how many points there are, and places, where several points lie in one."""
    apart = prim["places"] < prim["points"]
    return f"{prim['points']} points" + (f" at {prim['places']} places" if apart else "")


def _tell_runs(runs: Sequence[dict[str, Any]]) -> None:
    for run in runs[:FEW_RUNS]:
        kind = f", cannot hold a mark: {run['reason']}" if run["reason"] else ""
        typer.echo(f"    frames {run['first']:g}:{run['last']:g}: {run['points']} points{kind}")
    if len(runs) > FEW_RUNS:
        typer.echo(f"    and {len(runs) - FEW_RUNS} more; --json lists them")
