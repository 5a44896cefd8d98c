"""`meshmark verify`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from meshmark.cli.batch import (
    Batch,
    JobsOption,
    JsonlOption,
    ResumeOption,
    SchedulerOption,
    TimeoutOption,
)
from meshmark.cli.console import put_json, say
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
    read_recipients,
    reader_parameters,
    require_taken,
)
from meshmark.cli.repeating import given_options
from meshmark.cli.verdicts import tell
from meshmark.extension.defaults import DEFAULT_GEODESIC, DEFAULT_SEGMENTER

if TYPE_CHECKING:
    from meshmark.commands.outcome import Outcome
    from meshmark.detection.verdict import Verdict


def verify(
    context: typer.Context,
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="SOURCE|FOLDER|@LIST...",
            help="Copies to verify; all in a FOLDER and below; patterns, in quotes; those that a "
            "file names one a line (@@NAME for the file @NAME).",
            show_default=False,
        ),
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
    store: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="Keep the evidence of every SOURCE there, for `meshmark try`; what is kept there "
            "already is not measured again.",
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
    jsonl: JsonlOption = False,
    resume: ResumeOption = None,
    jobs: JobsOption = None,
    timeout: TimeoutOption = None,
    commands: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write shell commands that do it, one a line, and verify nothing."
        ),
    ] = None,
    chunk: Annotated[int, typer.Option(min=1, help="Sources of one such command.")] = 10,
    scheduler: SchedulerOption = None,
) -> None:
    """Say whether each SOURCE bears the key's mark, whose copy it is, and the bound on p."""
    from meshmark.errors import UsageError

    if not 0.0 < fpr < 1.0:
        raise UsageError(f"--fpr must lie between 0 and 1, not {fpr:g}")
    if evidence is not None and store is not None:
        raise UsageError("--evidence and --store both say where evidence is kept: give one")
    if store is not None:
        from meshmark.detection.evidence_store import require_arrow

        require_arrow()
    if unauthenticated and evidence is None:
        raise UsageError("--unauthenticated-evidence needs --evidence")
    if master is not None and original is None:
        raise UsageError("--master needs --original")
    batch = Batch("verify", jsonl, resume, jobs, scheduler, timeout)
    batch.require_sense(json)
    if commands is not None and (json or scheduler is not None):
        raise UsageError("--commands verifies nothing by itself; no --json or --scheduler")
    recorded = batch.recorded
    from meshmark.commands.verification import Request, hashes_beside, recipes_asked
    from meshmark.sources.listing import listed

    named = listed(sources)
    elsewhere = scheduler is not None or commands is not None
    if evidence is not None and (len(named) > 1 or recorded or elsewhere):
        raise UsageError(
            "--evidence holds that of one SOURCE; no --jsonl, --resume, --scheduler or --commands"
        )
    parameters = reader_parameters(clip, fps, variant)
    require_taken(parameters, [*named, *([original] if original else [])])
    request = Request(
        key_file=key,
        key_id=load_key(key).id,
        recipes=recipes_asked(scheme, segmenter, geodesic, settings),
        named=bool(scheme),
        recipients=read_recipients(recipient),
        frames=frames,
        parameters=parameters,
        fpr=fpr,
        trusted=trusted,
        original=original,
        master=master,
        evidence=evidence,
        store=store,
        authenticated=not unauthenticated,
        recorded=recorded,
        timeout=timeout,
        beside=hashes_beside(original, master, trusted=trusted) if recorded else {},
    )
    if commands is not None:
        with batch.answers() as kept:
            known = {} if kept is None else kept.known(named, request)
        left = [source for source in named if source not in known]
        _write_commands(context, commands, left, chunk, resume)
        return
    from meshmark.commands.verify import verify_file

    verdicts: dict[str, Verdict] = {}

    def told(outcome: Outcome[Verdict]) -> None:
        tell(outcome, everything)
        if json and outcome.verdict is not None:
            verdicts[outcome.source] = outcome.verdict

    tally = batch.run(named, request, verify_file, told)
    if json:
        put_json({"assets": [verdicts[each].as_json() for each in named if each in verdicts]})
    tally.end()


def _write_commands(
    context: typer.Context, path: Path, sources: Sequence[str], chunk: int, resume: Path | None
) -> None:
    from meshmark.commands.farm import verify_commands
    from meshmark.files.atomic import write_bytes

    options = given_options(context, without=("resume", "commands", "chunk"))
    lines = list(verify_commands(options, sources, chunk, resume))
    write_bytes(b"".join(os.fsencode(f"{line}\n") for line in lines), path)
    say(f"{path}: {len(lines):,} commands for {len(sources):,} sources")
