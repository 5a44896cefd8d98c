"""`meshmark verify`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshmark.cli.console import exit_code, frame_progress, put_json
from meshmark.cli.options import (
    ClipOption,
    FpsOption,
    GeodesicOption,
    JsonOption,
    KeyOption,
    SegmenterOption,
    SetOption,
    TrustedOption,
    VariantOption,
    load_key,
    reader_parameters,
    require_taken,
)
from meshmark.cli.verdicts import tell
from meshmark.extension.defaults import DEFAULT_GEODESIC, DEFAULT_SEGMENTER

if TYPE_CHECKING:
    from meshmark.commands.verify import Outcome


def verify(
    sources: Annotated[
        list[str],
        typer.Argument(metavar="SOURCE...", help="Copies to verify.", show_default=False),
    ],
    key: KeyOption,
    scheme: Annotated[
        list[str],
        typer.Option(
            help="Scheme of the mark, or several; by default those that embed uses, and those "
            "that a manifest beside SOURCE names."
        ),
    ] = [],  # noqa: B006 (typer makes a new list each time)
    segmenter: SegmenterOption = DEFAULT_SEGMENTER,
    geodesic: GeodesicOption = DEFAULT_GEODESIC,
    settings: SetOption = [],  # noqa: B006
    recipient: Annotated[
        list[str],
        typer.Option(
            "--recipient",
            metavar="NAME|@FILE",
            help="A recipient to try (@@NAME for @NAME), or a file of names, one a line; "
            "p is corrected for their number.",
        ),
    ] = [],  # noqa: B006
    frames: Annotated[
        str,
        typer.Option(
            metavar="A:B[:S]|auto",
            help="Time codes from A to B, every S-th frame (`:` looks at everything); auto "
            "samples few frames first, and more only while the answer is open.",
        ),
    ] = "auto",
    original: Annotated[
        str | None,
        typer.Option(
            metavar="SOURCE",
            help="What the copies may have been made from: far more is found beside it.",
        ),
    ] = None,
    master: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="The original as `embed --master` kept it; made again from original and key "
            "without it.",
        ),
    ] = None,
    clip: ClipOption = None,
    fps: FpsOption = None,
    variant: VariantOption = [],  # noqa: B006
    evidence: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Read the evidence from FILE; if it does not exist, measure it and write it.",
        ),
    ] = None,
    unauthenticated: Annotated[
        bool,
        typer.Option(
            "--unauthenticated-evidence",
            help="Report what FILE says although it may be forged; the answer is inconclusive.",
        ),
    ] = False,
    fpr: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Largest p that counts as marked.")
    ] = 1e-6,
    everything: Annotated[
        bool, typer.Option("--all", help="Print every mesh, not only the eight with the lowest p.")
    ] = False,
    trusted: TrustedOption = False,
    json: JsonOption = False,
) -> None:
    """Say whether each SOURCE bears the key's mark, whose copy it is, and the bound on p."""
    from meshmark.errors import UsageError

    if not 0.0 < fpr < 1.0:
        raise UsageError(f"--fpr must lie between 0 and 1, not {fpr:g}")
    if evidence is not None and len(sources) > 1:
        raise UsageError("--evidence holds that of one SOURCE")
    if unauthenticated and evidence is None:
        raise UsageError("--unauthenticated-evidence needs --evidence")
    if master is not None and original is None:
        raise UsageError("--master needs --original")
    parameters = reader_parameters(clip, fps, variant)
    require_taken(parameters, [*sources, *([original] if original else [])])
    from meshmark.commands.verify import Request, recipes_asked, verify_file
    from meshmark.workers.ordered_map import default_jobs

    request = Request(
        key_file=key,
        key_id=load_key(key).id,
        recipes=recipes_asked(scheme, segmenter, geodesic, settings),
        named=bool(scheme),
        recipients=_names(recipient),
        frames=frames,
        parameters=parameters,
        fpr=fpr,
        trusted=trusted,
        original=original,
        master=master,
        evidence=evidence,
        authenticated=not unauthenticated,
        jobs=default_jobs(),
    )
    outcomes: list[Outcome] = []
    for source in sources:
        with frame_progress() as progress:
            outcomes.append(verify_file(source, request, progress))
        tell(outcomes[-1], everything)
    if json:
        put_json({"assets": [each.verdict.as_json() for each in outcomes if each.verdict]})
    worst = max(outcome.exit_code for outcome in outcomes)
    code = worst or exit_code(each.verdict.verdict for each in outcomes if each.verdict)
    if code:
        raise typer.Exit(code)


def _names(recipients: Sequence[str]) -> list[str]:
    from meshmark.recipients import name_or_file, read_names, spellings

    names: list[str] = []
    for text in recipients:
        named = name_or_file(text)
        names += [named] if isinstance(named, str) else read_names(named)
    return list(spellings(names))
