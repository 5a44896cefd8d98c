"""`meshmark report`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshmark.cli.console import exit_code, frame_progress, say
from meshmark.cli.options import (
    ClipOption,
    FpsOption,
    GeodesicOption,
    KeyOption,
    OutputOption,
    SegmenterOption,
    SetOption,
    TrustedOption,
    VariantOption,
    load_key,
    reader_parameters,
    require_taken,
)
from meshmark.cli.repeating import typed_command
from meshmark.extension.defaults import DEFAULT_GEODESIC, DEFAULT_SEGMENTER

if TYPE_CHECKING:
    from meshmark.commands.identification import Identification
    from meshmark.commands.verification import Request
    from meshmark.detection.verdict import Verdict
    from meshmark.reporting.sources import Sources


def report(
    context: typer.Context,
    copy: Annotated[str, typer.Argument(help="The copy to report on.", show_default=False)],
    key: KeyOption,
    output: OutputOption,
    scheme: Annotated[
        list[str], typer.Option(help="Scheme of the mark, or several; as of verify.")
    ] = [],  # noqa: B006 (typer makes a new list each time)
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    geodesic: GeodesicOption = DEFAULT_GEODESIC,
    settings: SetOption = [],  # noqa: B006
    recipient: Annotated[
        list[str],
        typer.Option(
            "--recipient", metavar="NAME|@FILE", help="A recipient to try, or a file of names."
        ),
    ] = [],  # noqa: B006
    frames: Annotated[
        str, typer.Option(metavar="A:B[:S]|auto", help="Time codes to look at; as of verify.")
    ] = "auto",
    original: Annotated[
        str | None, typer.Option(metavar="SOURCE", help="What the copy may have been made from.")
    ] = None,
    master: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="The original as `embed --master` kept it."),
    ] = None,
    ledger: Annotated[
        str | None,
        typer.Option(
            metavar="URL", help="Find original, master and recipient in this ledger, by KEY."
        ),
    ] = None,
    clip: ClipOption = None,
    fps: FpsOption = None,
    variant: VariantOption = [],  # noqa: B006
    fpr: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Largest p that counts as marked.")
    ] = 1e-6,
    trusted: TrustedOption = False,
) -> None:
    """Verify COPY and write one HTML page: verdict, 3D view, evidence, what was searched."""
    from meshmark.errors import UsageError
    from meshmark.reporting.report import require_page

    if not 0.0 < fpr < 1.0:
        raise UsageError(f"--fpr must lie between 0 and 1, not {fpr:g}")
    if ledger is not None and (original or master or recipient or scheme):
        raise UsageError("--ledger names original, master, recipients and schemes itself")
    if master is not None and original is None:
        raise UsageError("--master needs --original")
    require_page(output)
    parameters = reader_parameters(clip, fps, variant)
    require_taken(parameters, [copy, *([original] if original else [])])
    from meshmark.commands.verification import Request, recipes_asked
    from meshmark.workers.ordered_map import default_jobs

    names, lists = _names(recipient)
    request = Request(
        key_file=key,
        key_id=load_key(key).id,
        recipes=recipes_asked(scheme, segmenter, geodesic, settings),
        named=bool(scheme),
        recipients=names,
        frames=frames,
        parameters=parameters,
        fpr=fpr,
        trusted=trusted,
        original=original,
        master=master,
        jobs=default_jobs(),
    )
    instead = {"key": "KEYFILE"}
    found = None
    if ledger is not None:
        sources, verdict, found, instead["ledger"] = _identified(copy, ledger, request)
    else:
        sources, verdict = _verified(copy, request, lists)
    from meshmark.files.atomic import write_text
    from meshmark.reporting.report import copy_page

    text = copy_page(
        sources,
        verdict,
        request,
        command=typed_command(context, instead),
        found=found,
        jobs=request.jobs,
    )
    write_text(text, output)
    whose = f", copy of {verdict.recipient}" if verdict.recipient else ""
    say(f"{copy}: {verdict.verdict}{whose}, log10 p {verdict.log10_p:.2f}")
    say(f"{output}: written, {len(text.encode()) / 1e6:.2f} MB")
    code = exit_code([verdict.verdict])
    if code:
        raise typer.Exit(code)


def _names(recipients: Sequence[str]) -> tuple[list[str], list[tuple[str, Path]]]:
    """Return the names to try, and the files that some of them are from."""
    from meshmark.recipients import name_or_file, read_names, spellings

    names: list[str] = []
    files: list[tuple[str, Path]] = []
    for text in recipients:
        named = name_or_file(text)
        if isinstance(named, str):
            names.append(named)
        else:
            names += read_names(named)
            files.append(("names", named))
    return list(spellings(names)), files


def _verified(
    copy: str, request: Request, lists: Sequence[tuple[str, Path]]
) -> tuple[Sources, Verdict]:
    from meshmark.commands.verify import verify_asset
    from meshmark.reporting.sources import read_sources

    sources = read_sources(copy, request, lists)
    with frame_progress() as progress:
        return sources, verify_asset(sources.copy, request, progress)


def _identified(
    copy: str, ledger: str, request: Request
) -> tuple[Sources, Verdict, Identification, str]:
    """Look a copy up in a ledger, among what was marked with this key."""
    from meshmark.cli.ledger import opened

    kept = opened(ledger)
    from meshmark.commands.identify import identify
    from meshmark.detection.verdict import Verdict
    from meshmark.ledger.origins import origins
    from meshmark.reporting.sources import read_sources

    sources = read_sources(copy, request, [])
    own = [each for each in origins(kept.entries()) if each.key_id == request.key_id]
    with frame_progress() as progress:

        def tell(prim: str, done: int, total: int) -> None:
            progress("identify", prim, done, total)

        key = request.key()
        found = identify(
            sources.copy, own, {key.id: key}, fpr=request.fpr, jobs=request.jobs, progress=tell
        )
    best = Verdict.of_nothing(copy, found.notes) if found.best is None else found.best.verdict
    # What was not looked at leaves the answer open.
    return sources, replace(best, verdict=found.verdict), found, kept.name
